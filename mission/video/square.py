"""Pictures with square pixels, of a camera whose pixels are not.

A picture that was scaled to another shape (an AR.Drone's 1280 x 720 to the 640 x 480 of Kim & Yow 2015) shows people a
third too tall. Detectors were trained on people of natural shape, an upright window cut out of such a picture is
sheared as soon as the camera rolls, and one number for a pixel's noise is wrong on one of the axes. The lens knows
better: fx and fy in pixels are the same length, so the picture is brought back to the shape that the lens saw.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from mission.camera.camera import Camera
from mission.records import Box, Frame
from mission.video.recorder import Recordable, Recording
from mission.video.source import VideoSource
from mission.video.stats import VideoStats

SQUARE = 0.02
"""Pixels whose sides differ by less are taken for square: a calibration is not better than a few tenths of a percent,
and nothing that looks at pictures of people notices."""


def square_camera(camera: Camera) -> Camera:
    """The camera as `SquareVideo` shows it; the same one where its pixels are square already.

    The axis with the coarser pixels is enlarged, so that nothing is lost.

    Args:
        camera: of the pictures as they come.
    """
    lens = camera.intrinsics
    if abs(lens.fx / lens.fy - 1.0) < SQUARE:
        return camera
    focal = max(lens.fx, lens.fy)
    width, height = round(lens.width_px * focal / lens.fx), round(lens.height_px * focal / lens.fy)
    across, down = width / lens.width_px, height / lens.height_px
    square = replace(
        lens,
        width_px=width,
        height_px=height,
        fx=lens.fx * across,
        fy=lens.fy * down,
        cx=lens.cx * across,
        cy=lens.cy * down,
    )
    return replace(camera, intrinsics=square)


class SquareVideo:
    """A `VideoSource` whose pictures are brought to square pixels.

    Args:
        source: of the pictures as they come; closed with this one.
        before: the camera of those pictures.
        after: the same camera with square pixels.
    """

    def __init__(self, source: VideoSource, before: Camera, after: Camera) -> None:
        self._source = source
        self._size = after.intrinsics.width_px, after.intrinsics.height_px
        self._across = after.intrinsics.width_px / before.intrinsics.width_px
        self._down = after.intrinsics.height_px / before.intrinsics.height_px

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        """See `VideoSource.latest`."""
        frame = self._source.latest(after_index, timeout_s)
        if frame is None:
            return None
        image = cv2.resize(frame.image, self._size, interpolation=cv2.INTER_LINEAR)
        return replace(frame, image=np.asarray(image, np.uint8))

    def stats(self) -> VideoStats:
        """See `VideoSource.stats`."""
        return self._source.stats()

    def start_recording(self, path: Path, max_bytes: int) -> None:
        """Of the pictures as they come, where the source can."""
        if hasattr(self._source, "start_recording"):
            cast(Recordable, self._source).start_recording(path, max_bytes)

    def stop_recording(self) -> Recording | None:
        """See `mission.video.recorder.Recordable`."""
        return cast(Recordable, self._source).stop_recording() if hasattr(self._source, "stop_recording") else None

    def close(self) -> None:
        """See `VideoSource.close`."""
        self._source.close()

    def point(self, x_px: float, y_px: float) -> tuple[float, float]:
        """Where a point of the pictures as they come lies in these."""
        return x_px * self._across, y_px * self._down

    def box(self, box: Box) -> Box:
        """A box of the pictures as they come, in these."""
        return Box(
            box.left_px * self._across, box.top_px * self._down, box.width_px * self._across, box.height_px * self._down
        )


def with_square_pixels(source: VideoSource, camera: Camera) -> tuple[VideoSource, Camera]:
    """Video and camera for everything that looks at pictures; the same ones where the pixels are square already."""
    square = square_camera(camera)
    return (source, camera) if square is camera else (SquareVideo(source, camera, square), square)
