"""Finding people in a picture, and choosing the one that the operator means."""

from __future__ import annotations

from typing import Literal

from mission.detect.auto import AutoDetector
from mission.detect.choose import choose
from mission.detect.confirmation import Confirmation
from mission.detect.detector import Detector
from mission.detect.hog import HogDetector
from mission.detect.nanodet import NanoDetDetector
from mission.detect.tiles import TiledDetector

DetectorName = Literal["auto", "hog", "nanodet", "tiles"]

__all__ = [
    "AutoDetector",
    "Confirmation",
    "Detector",
    "DetectorName",
    "HogDetector",
    "NanoDetDetector",
    "choose",
    "make_detector",
]


def make_detector(name: DetectorName = "auto") -> Detector:
    """The detector of that name.

    Raises:
        DetectionError: the network cannot be read (all but hog).
    """
    match name:
        case "auto":
            return AutoDetector()
        case "hog":
            return HogDetector()
        case "nanodet":
            return NanoDetDetector()
        case "tiles":
            return TiledDetector()
