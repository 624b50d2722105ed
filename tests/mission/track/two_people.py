"""The target and somebody else, as the tests of who is who have them."""

from __future__ import annotations

from mission.records import Box
from mission.track.measure import Extent
from mission.track.motion import Motion
from mission.track.other import Other

HEIGHT = 200.0
X = 320.0
FRAME_S = 0.05


def body(x: float = X, height: float = HEIGHT, score: float = 0.8) -> Extent:
    top, bottom = 240.0 - 0.5 * height, 240.0 + 0.5 * height
    box = Box(x - 30.0, top, 60.0, height)
    return Extent((x, 240.0), (x, top), (x, bottom), height, score, True, True, True, box)


def target() -> Motion:
    return Motion((X, 240.0), HEIGHT, 0.01, 0.03)


def walked(first_px: float, last_px: float, frames: int = 10, height: float = HEIGHT) -> Other:
    """Somebody seen on their way, last at 0 s."""
    other = Other.at(body(first_px, height), target(), -frames * FRAME_S, 0.0)
    for k in range(1, frames + 1):
        other.motion.predict(FRAME_S, (0.0, 0.0))
        other.see(body(first_px + (last_px - first_px) * k / frames, height), (k - frames) * FRAME_S, 0.0)
        other.looks += 1
    return other


def later(motion: Motion, after_s: float) -> None:
    for _ in range(round(after_s / FRAME_S)):
        motion.predict(FRAME_S, (0.0, 0.0))
