"""Where the body's centre is in the picture and how tall the body is, filtered over the frames."""

from __future__ import annotations

import numpy as np

from mission.records import Vector
from mission.track.drift import DriftFilter

_SPEED_SIGMA = 0.3
"""Body heights per second: walking, and the camera's travel told wrongly."""
_LOG_HEIGHT_RATE_SIGMA = 0.15
"""Per second: passing a person at 3 m with 1.6 m/s gives 0.24."""
_RATE_S = 4.0


class Motion:
    """Place and size of the body.

    Velocities are those that the camera's own motion does not explain.

    Args:
        pixel: the body's centre.
        height_px: of the body.
        sigma: of the place, body heights.
        size_sigma: of the log of the height.
    """

    def __init__(self, pixel: tuple[float, float], height_px: float, sigma: float, size_sigma: float) -> None:
        speed = _SPEED_SIGMA * height_px
        self._place = [DriftFilter(v, sigma * height_px, speed, _RATE_S) for v in pixel]
        self._size = DriftFilter(float(np.log(height_px)), size_sigma, _LOG_HEIGHT_RATE_SIGMA, _RATE_S)

    @property
    def pixel(self) -> Vector:
        """(2,) the body's centre."""
        return np.array([axis.value for axis in self._place])

    @property
    def sigma_px(self) -> Vector:
        """(2,) of the place, if the measurements' errors were white."""
        return np.array([axis.sigma for axis in self._place])

    @property
    def height_px(self) -> float:
        """The body's height."""
        return float(np.exp(self._size.value))

    @property
    def size_sigma(self) -> float:
        """Of the log of the height, if the measurements' errors were white."""
        return self._size.sigma

    def predict(self, dt_s: float, shift_px: tuple[float, float], passed: tuple[float, float] = (0.0, 0.0)) -> None:
        """To the time of the next frame.

        Args:
            dt_s: time since the last one.
            shift_px: how far the camera's own rotation moved the picture.
            passed: how far its travel moved the person, body heights.
        """
        height = self.height_px
        for axis, turned, travelled in zip(self._place, shift_px, passed, strict=True):
            axis.predict(dt_s, _SPEED_SIGMA * height, turned + travelled * height)
        self._size.predict(dt_s, _LOG_HEIGHT_RATE_SIGMA)

    def vanish(self) -> None:
        """The person went out of sight: half a person that shrinks is no person who walks away."""
        self._size.settle()

    def see(self, axis: int, measured_px: float, sigma: float) -> None:
        """Use a measured place; axis 0 is x, 1 is y; sigma in body heights."""
        self._place[axis].update(measured_px, sigma * self.height_px)

    def see_height(self, height_px: float, sigma: float) -> None:
        """Use a measured height; sigma of its logarithm."""
        self._size.update(float(np.log(height_px)), sigma)
