"""A flight's sightings as arrays: what was seen, where the camera was reported to be, and how exact each channel is."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission.camera.model import CameraModel
from mission.records import CameraIntrinsics, FlightSightings, Matrix, NoiseModel, Sighting, TargetPrior, Vector

LEAST_PIXEL_SIGMA_PX = 0.02
"""No measurement in a picture is better than this; it also keeps a stated sigma of zero solvable."""
LEAST_SIZE_SIGMA = 1e-3
"""The same for the logarithm of the height."""
LEAST_GROUND_SIGMA_M = 1e-3
"""The same for the height of the ground."""
LARGEST = 1e6
"""Sigmas, correlation times and intensities beyond this mean "unknown" or "for ever"."""
_FARTHEST_TANGENT = 1e3
"""A pixel this far off the axis, in tangents, is no measurement."""
_NOISE_FIELDS = tuple(field.name for field in fields(NoiseModel))
_PRIOR_FIELDS = tuple(field.name for field in fields(TargetPrior))


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Sightings in time order, relative to the first reported camera position and the first time."""

    index: NDArray[np.intp]
    """(n,), which sighting of the flight each row is."""
    t_s: Vector
    """(n,), since the first sighting of the flight."""
    steps_s: Vector
    """(n - 1,)."""
    camera_m: Matrix
    """(n, 3), reported camera position relative to `reference_m`."""
    camera_from_world: Matrix
    """(n, 3, 3), reported."""
    measured: Matrix
    """(n, 3): ideal image coordinates x, y (tangents), and the log of the apparent height in tangents."""
    scale: Matrix
    """(n, 2, 2): d(pixel) / d(ideal coordinates) divided by the pixel sigma."""
    size_scale: Vector
    """(n,), one over the sigma of log height; 0 where there is no height."""
    reference_m: Vector
    """(3,), ENU."""
    start_s: float

    def only(self, keep: NDArray[np.bool_], sized: NDArray[np.bool_] | None = None) -> Observations:
        """The rows to keep, and the rows whose height is to be kept, both (n,)."""
        scale = self.size_scale if sized is None else np.where(sized, self.size_scale, 0.0)
        t = self.t_s[keep]
        return Observations(
            self.index[keep],
            t,
            np.diff(t),
            self.camera_m[keep],
            self.camera_from_world[keep],
            self.measured[keep],
            self.scale[keep],
            scale[keep],
            self.reference_m,
            self.start_s,
        )


def observe(flight: FlightSightings) -> Observations:
    """The flight as arrays; sightings that no ray of the lens model reaches are left out.

    Sightings of equal time are put in one order, whatever order they came in, so that the answer does not hang on it.
    """
    rows, taken = _in_order(flight.sightings)
    noise = flight.noise
    table = np.array([_row(s, noise.pixel_sigma_px, noise.size_sigma) for s in taken], dtype=float).reshape(-1, 13)
    numbers, heights, pixel_sigma, size_sigma = table[:, :10], table[:, 10], table[:, 11], table[:, 12]
    camera = flight.camera
    ideal, per_ideal = _undistorted(numbers[:, 8:10], camera)
    has_size = np.isfinite(heights)
    measured = np.column_stack((ideal, np.log(np.where(has_size, heights, camera.fy) / camera.fy)))
    reference = numbers[0, 1:4] if len(taken) else np.zeros(3)
    start = float(numbers[0, 0]) if len(taken) else 0.0
    t = numbers[:, 0] - start
    everything = Observations(
        np.array(rows, dtype=np.intp),
        t,
        np.diff(t),
        numbers[:, 1:4] - reference,
        _matrices(numbers[:, 4:8]),
        measured,
        per_ideal / np.clip(pixel_sigma, LEAST_PIXEL_SIGMA_PX, LARGEST)[:, None, None],
        np.where(has_size, 1.0 / np.clip(size_sigma, LEAST_SIZE_SIGMA, LARGEST), 0.0),
        reference,
        start,
    )
    usable: NDArray[np.bool_] = np.abs(ideal).max(axis=1, initial=0.0) < _FARTHEST_TANGENT  # NaN is not
    return everything if usable.all() else everything.only(usable)


def tamed_noise(noise: NoiseModel) -> NoiseModel:
    """The noise model with `LARGEST` as its largest number."""
    return NoiseModel(**{name: min(getattr(noise, name), LARGEST) for name in _NOISE_FIELDS})


def tamed_prior(prior: TargetPrior) -> TargetPrior:
    """The prior with `LARGEST` as its largest number."""
    values = {name: getattr(prior, name) for name in _PRIOR_FIELDS}
    numbers: dict[str, Any] = {n: min(value, LARGEST) for n, value in values.items() if isinstance(value, float | int)}
    return replace(prior, **numbers)


def _in_order(sightings: tuple[Sighting, ...]) -> tuple[list[int], list[Sighting]]:
    """Indices and sightings by time; sightings of equal time by what they saw."""
    times = [s.t_s for s in sightings]
    if len(set(times)) == len(times) and times == sorted(times):
        return list(range(len(times))), list(sightings)
    rows = sorted(range(len(times)), key=lambda i: _order(sightings[i]))
    return rows, [sightings[i] for i in rows]


def _row(s: Sighting, pixel_sigma_px: float, size_sigma: float) -> tuple[float, ...]:
    return (
        s.t_s,
        *s.position_enu_m,
        *s.world_from_camera_wxyz,
        *s.pixel,
        s.height_px or math.nan,
        pixel_sigma_px if s.pixel_sigma_px is None else s.pixel_sigma_px,
        size_sigma if s.size_sigma is None else s.size_sigma,
    )


def _order(sighting: Sighting) -> tuple[float, ...]:
    return (sighting.t_s, *sighting.pixel, sighting.height_px or 0.0, *sighting.position_enu_m)


def _matrices(wxyz: Matrix) -> Matrix:
    """(n, 3, 3) camera_from_world of unit quaternions world_from_camera (w, x, y, z), (n, 4)."""
    w, x, y, z = np.ascontiguousarray(wxyz.T)
    matrices = np.empty((len(w), 3, 3))
    matrices[:, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrices[:, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrices[:, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    xy, xz, yz, wx, wy, wz = x * y, x * z, y * z, w * x, w * y, w * z
    matrices[:, 0, 1], matrices[:, 1, 0] = 2.0 * (xy + wz), 2.0 * (xy - wz)
    matrices[:, 0, 2], matrices[:, 2, 0] = 2.0 * (xz - wy), 2.0 * (xz + wy)
    matrices[:, 1, 2], matrices[:, 2, 1] = 2.0 * (yz + wx), 2.0 * (yz - wx)
    return matrices


def _undistorted(pixels: Matrix, camera: CameraIntrinsics) -> tuple[Matrix, Matrix]:
    """Ideal coordinates (n, 2) of pixels (n, 2), and d(pixel) / d(ideal) there, (n, 2, 2)."""
    per_ideal = np.zeros((len(pixels), 2, 2))
    if not any(camera.distortion):
        per_ideal[:, 0, 0], per_ideal[:, 1, 1] = camera.fx, camera.fy
        return (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy), per_ideal
    rays = CameraModel(camera).ray(pixels)
    ideal = rays[:, :2] / rays[:, 2:]
    k1, k2, p1, p2, k3 = camera.distortion
    x, y = ideal[:, 0], ideal[:, 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3)  # d(radial) / d(r2)
    across = 2.0 * (x * y * slope + p1 * x + p2 * y)
    per_ideal[:, 0, 0] = camera.fx * (radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x)
    per_ideal[:, 0, 1] = camera.fx * across
    per_ideal[:, 1, 0] = camera.fy * across
    per_ideal[:, 1, 1] = camera.fy * (radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x)
    return ideal, per_ideal
