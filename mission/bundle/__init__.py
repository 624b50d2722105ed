"""Bearings steadied by the background: the camera's path and attitude from points of the picture that do not move."""

from mission.bundle.bundle_adjuster import BundleAdjuster
from mission.bundle.solution import AdjustedPose, AttitudeCurves, BundleSolution, PointTrails, PoseSource, rows_at

__all__ = [
    "AdjustedPose",
    "AttitudeCurves",
    "BundleAdjuster",
    "BundleSolution",
    "PointTrails",
    "PoseSource",
    "rows_at",
]
