"""HOG's boxes where the network sees the same people, NanoDet's for the rest; HOG alone where the network is blind."""

from __future__ import annotations

from mission.detect.detector import Detector
from mission.detect.hog import HogDetector
from mission.detect.nanodet import NanoDetDetector
from mission.records import Box, Detection, Image

_SAME_HEIGHT = 1.6
"""Largest ratio of the heights of one body; HOG's box is up to a third too tall, and half a body is half as tall."""
_SURE = 0.5
"""Score from which on NanoDet needs no confirmation by HOG where HOG confirms somebody else."""


class AutoDetector:
    """The people that NanoDet sees, in HOG's boxes where it sees them too; HOG's where NanoDet sees nobody.

    Where both see somebody, NanoDet must be surer of those whom it sees alone.

    HOG answers with a tree or a lamp where the person is too small (a body of less than about 90 px), stands oddly, or
    is so near that its window, a third taller than the body, does not fit into the picture.

    Args:
        near: its boxes count where `far` sees the same people, or nobody at all.
        far: asked as well.
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
        near, far = self._near.detect(image, region), self._far.detect(image, region)
        if not far:
            return near
        both = [one for one in near if any(_same(one.box, other.box) for other in far)]
        if not both:
            return far
        return both + [one for one in far if one.score > _SURE and not any(_same(one.box, two.box) for two in both)]


def _same(one: Box, other: Box) -> bool:
    """Whether two detectors mean the same body: each box holds the other's middle, and they are of about one height."""
    alike = 1.0 / _SAME_HEIGHT < one.height_px / other.height_px < _SAME_HEIGHT
    return alike and one.contains(*other.centre_px) and other.contains(*one.centre_px)
