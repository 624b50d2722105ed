"""What the tracker answers for each frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mission.records import Box

TrackState = Literal["tracking", "coasting", "lost"]
"""tracking: seen in this frame; coasting: hidden for a moment, predicted; lost: it needs a new start."""


@dataclass(frozen=True, slots=True)
class Track:
    """The target in one frame. Pixels, (0, 0) = outer corner of the top left pixel."""

    frame_index: int
    t_s: float
    state: TrackState
    box: Box
    """Around the whole body, upright; the last known one when lost."""
    pixel: tuple[float, float]
    """The body's centre: always the same point of the body. Predicted while coasting."""
    pixel_sigma_px: float
    """Per axis, of a slowly varying (gait) error, see `mission.track.noise`."""
    height_px: float | None
    """Apparent height head to foot, up to a factor that is constant over the track; None where it was not seen."""
    size_sigma: float | None
    """Of log height."""
    score: float
    """How well this frame agrees with the target's looks, 0 to 1."""
