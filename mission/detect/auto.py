"""HOG where the person is large enough, NanoDet for the rest."""

from __future__ import annotations

from mission.detect.detector import Detector
from mission.detect.hog import HogDetector
from mission.detect.nanodet import NanoDetDetector
from mission.records import Box, Detection, Image


class AutoDetector:
    """HOG first; where it finds nobody (a body of less than about 90 px, an odd posture), NanoDet.

    Args:
        near: used first.
        far: used where `near` finds nobody.
    """

    def __init__(self, near: Detector | None = None, far: Detector | None = None) -> None:
        self._near = near or HogDetector()
        self._far = far or NanoDetDetector()

    @property
    def name(self) -> str:
        """``auto``."""
        return "auto"

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        """See `mission.detect.detector.Detector.detect`."""
        return self._near.detect(image, region) or self._far.detect(image, region)
