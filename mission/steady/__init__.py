"""Bearings steadied by the background: the camera's path and attitude from points of the picture that do not move."""

from mission.steady.steadied import AttitudeCurves, PointTrails, PoseSource, Steadied, SteadiedPose, rows_at
from mission.steady.steadier import ENOUGH_STILL, Steadier

__all__ = [
    "ENOUGH_STILL",
    "AttitudeCurves",
    "PointTrails",
    "PoseSource",
    "Steadied",
    "SteadiedPose",
    "Steadier",
    "rows_at",
]
