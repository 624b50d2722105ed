"""Where the body's centre is in the picture and how tall the body is, filtered over the frames."""

from __future__ import annotations

import numpy as np

from mission.records import Vector
from mission.track import noise
from mission.track.drift import DriftFilter

_SPEED_SIGMA = 0.3
"""Body heights per second: walking, and the camera's travel told wrongly."""
_LOG_HEIGHT_RATE_SIGMA = 0.15
"""Per second: passing a person at 3 m with 1.6 m/s gives 0.24."""
_RATE_S = 4.0
_INNOVATIONS = (10.0, 60.0)
"""For how many looks the usual noise counts before any, and after how many a look is forgotten."""
_NOISE_OF_INNOVATION = 0.75
"""Standard deviation of a measurement over that of its innovation: the filter follows closely, so the last one's error
is in it as well."""
_LARGEST_NOISE = 0.05
"""Body heights."""


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
        self._noise_var = [noise.USUAL_SIGMA**2, noise.USUAL_SIGMA**2]
        self._looks = [_INNOVATIONS[0], _INNOVATIONS[0]]

    @property
    def pixel(self) -> Vector:
        """(2,) the body's centre."""
        return np.array([axis.value for axis in self._place])

    @property
    def sigma_px(self) -> Vector:
        """(2,) of the place, if the measurements' errors were white."""
        return np.array([axis.sigma for axis in self._place])

    @property
    def noise(self) -> float:
        """Standard deviation of the fine measurements by their innovations, body heights, of the worse direction.

        Rendered people stand out from their background more sharply than most real ones, and a gait may be wide or
        narrow: how well a body is measured is known best from itself.
        """
        return float(np.sqrt(max(self._noise_var)))

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

    def learnt_from(self, before: Motion) -> Motion:
        """The same with the noise that was learnt before somebody went out of sight."""
        self._noise_var, self._looks = list(before._noise_var), list(before._looks)
        return self

    def vanish(self) -> None:
        """The person went out of sight: half a person that shrinks is no person who walks away."""
        self._size.settle()

    def see(self, axis: int, measured_px: float, sigma: float) -> None:
        """Use a measured place; axis 0 is x, 1 is y; sigma in body heights."""
        self._place[axis].update(measured_px, sigma * self.height_px)

    def see_finely(self, axis: int, measured_px: float, sigma: float) -> None:
        """The same for a measurement by which the noise is learnt, and which counts less where it is noisier."""
        off = _NOISE_OF_INNOVATION * (measured_px - self._place[axis].value) / self.height_px
        learnt = np.sqrt(self._noise_var[axis])
        self._looks[axis] = min(self._looks[axis] + 1.0, _INNOVATIONS[1])
        counted = min(abs(off), 3.0 * learnt, _LARGEST_NOISE) ** 2
        self._noise_var[axis] += (counted - self._noise_var[axis]) / self._looks[axis]
        self.see(axis, measured_px, max(sigma, float(learnt) * sigma / noise.USUAL_SIGMA))

    def see_height(self, height_px: float, sigma: float) -> None:
        """Use a measured height; sigma of its logarithm."""
        self._size.update(float(np.log(height_px)), sigma)
