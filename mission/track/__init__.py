"""The same person from frame to frame."""

from __future__ import annotations

from mission.track.track import Track, TrackState
from mission.track.tracker import Tracker

__all__ = ["Track", "TrackState", "Tracker"]
