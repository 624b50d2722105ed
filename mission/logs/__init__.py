"""Flight logs of others, as one record: the camera's poses on one clock (`PoseLog`)."""

from __future__ import annotations

from mission.logs.pose_log import Attitudes, LogKind, PoseLog, Positions
from mission.logs.read import LOG_SUFFIXES, kind_of, read_log

__all__ = ["LOG_SUFFIXES", "Attitudes", "LogKind", "PoseLog", "Positions", "kind_of", "read_log"]
