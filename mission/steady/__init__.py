"""Bearings steadied by the background: the camera's path and attitude from points of the picture that do not move."""

from mission.steady.steadied import AttitudeCurves, PointTrails, PoseSource, Steadied, SteadiedPose, rows_at
from mission.steady.steadier import Steadier

__all__ = [
    "AttitudeCurves",
    "PointTrails",
    "PoseSource",
    "Steadied",
    "SteadiedPose",
    "Steadier",
    "rows_at",
]
