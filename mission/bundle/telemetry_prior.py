"""What the telemetry says of the camera during the frames, and how far it may be off: levels fitted to the flight.

The shapes of the errors (how fast they wander) are those of two recorded autopilots; their sizes differ by a factor
of ten from one aircraft to the next, so they are found from what the pictures leave over, with what the aircraft says
of itself as a prior. Only slow parts are compared (a cosine transform cut at about 1 Hz): that is what the scale and
the directions are taken from, and the pictures' own noise has no part in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mission.bundle.gauge_alignment import PosePrior
from mission.bundle.gauss_markov import GaussMarkov
from mission.bundle.projection import Cameras
from mission.bundle.rotations import rotation_logarithm
from mission.camera.camera import Camera
from mission.pose.buffer import Pose
from mission.records import Matrix, NoiseModel, Vector
from mission.sighting import cameras_at

_RATE_SPAN_S = 0.05
"""Rates are taken from this long before to this long after."""
_PLACE_OFFSET_M = 1.0
"""Of the reported position, constant over the flight; nothing hangs on it."""
_FLOOR_M = 3e-3
_FLOOR_RAD = 3e-4
"""White errors that the priors allow for besides: the pictures' own, and shapes that are not quite right."""
_PRIOR_ROWS = 6.0
"""What the aircraft says of itself counts like this many numbers."""
_WAVES_PER_S = 1.0


@dataclass(frozen=True, slots=True)
class ErrorLevels:
    """How the reports err within a flight, and by how much all along it."""

    heading: GaussMarkov
    tilt: GaussMarkov
    horizontal: GaussMarkov
    vertical: GaussMarkov
    horizontal_velocity: GaussMarkov
    vertical_velocity: GaussMarkov
    heading_bias_rad: float
    tilt_bias_rad: float

    @classmethod
    def stated(cls, noise: NoiseModel) -> ErrorLevels:
        """From the noise model that the aircraft states of itself."""
        walk = noise.position_walk_m_per_sqrt_s
        return cls(
            heading=GaussMarkov(noise.heading_sigma_rad, 1.8),
            tilt=GaussMarkov(noise.tilt_sigma_rad, 5.5, 1),
            # A second-order process that moves as far within two seconds as the walk does.
            horizontal=GaussMarkov(1.7 * walk, 1.5),
            vertical=GaussMarkov(walk, 1.0),
            horizontal_velocity=GaussMarkov(2.4 * walk, 2.0),
            vertical_velocity=GaussMarkov(0.8 * walk, 0.7),
            heading_bias_rad=noise.heading_bias_sigma_rad,
            tilt_bias_rad=noise.tilt_bias_sigma_rad,
        )


@dataclass(frozen=True, slots=True, eq=False)
class TelemetryPrior:
    """The camera as reported at k times."""

    cameras: Cameras
    way_m: Matrix
    """(k, 3): the lens's way since the first time, the reported velocity summed up."""

    @classmethod
    def collect(
        cls, pose_at: Callable[[float], Pose | None], camera: Camera, times_s: Vector
    ) -> tuple[TelemetryPrior, NDArray[np.intp]]:
        """The reports at the times at which all is known, and those times' places (k,) among the given ones.

        Args:
            pose_at: the aircraft's pose at a telemetry time.
            camera: for its mounting.
            times_s: ascending telemetry times.
        """
        kept: list[int] = []
        poses: list[Pose] = []
        for number, t_s in enumerate(times_s.tolist()):
            now = pose_at(t_s)
            if now is None:
                continue
            before, after = pose_at(t_s - _RATE_SPAN_S) or now, pose_at(t_s + _RATE_SPAN_S) or now
            kept.append(number)
            poses.extend((before, now, after))
        places = np.array(kept, dtype=np.intp)
        shape = (len(kept), 3)
        if not kept:
            nothing = np.zeros(shape)
            return cls(Cameras(times_s[places], np.zeros((0, 3, 3)), nothing, nothing, nothing), nothing), places
        rotation, position = cameras_at(poses, camera)
        span = np.maximum(
            np.array([after.t_s - before.t_s for before, after in zip(poses[::3], poses[2::3], strict=True)]), 1e-3
        )
        cameras = Cameras(
            times_s[places],
            rotation[1::3].as_matrix(),
            position[1::3],
            (rotation[::3].inv() * rotation[2::3]).as_rotvec() / span[:, None],
            (position[2::3] - position[::3]) / span[:, None],
        )
        speed = np.array([now.velocity_enu_m_s for now in poses[1::3]])
        # The lens also goes about the aircraft where that turns, which is no part of the reported velocity.
        arm = cameras.position_m - np.array([now.position_enu_m for now in poses[1::3]])
        way = arm - arm[0]
        if len(kept) > 1:
            steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(cameras.t_s)[:, None]
            way[1:] += np.cumsum(steps, axis=0)
        return cls(cameras, way), places

    def only(self, places: NDArray[np.intp]) -> TelemetryPrior:
        """Some of the times."""
        c = self.cameras
        cameras = Cameras(
            c.t_s[places], c.rotation[places], c.position_m[places], c.turn_rate[places], c.velocity_m_s[places]
        )
        return TelemetryPrior(cameras, self.way_m[places])

    def prior(self, levels: ErrorLevels) -> PosePrior:
        """What these reports say of the corrections."""
        t_s = self.cameras.t_s
        white = np.eye(len(t_s))
        everywhere = np.ones((len(t_s), len(t_s)))
        tilt = levels.tilt.covariance(t_s) + levels.tilt_bias_rad**2 * everywhere + _FLOOR_RAD**2 * white
        heading = levels.heading.covariance(t_s) + levels.heading_bias_rad**2 * everywhere + _FLOOR_RAD**2 * white
        level = np.linalg.inv(tilt)
        between = self.way_m - self.cameras.position_m
        between = between - between.mean(axis=0)
        rest = _PLACE_OFFSET_M**2 * everywhere + _FLOOR_M**2 * white
        across, up = (
            (np.linalg.inv(place.covariance(t_s) + rest), np.linalg.inv(speed.integral_covariance(t_s) + rest))
            for place, speed in (
                (levels.horizontal, levels.horizontal_velocity),
                (levels.vertical, levels.vertical_velocity),
            )
        )
        information, mean = [], []
        for axis, (by_place, by_speed) in enumerate((across, across, up)):
            information.append(by_place + by_speed)
            mean.append(np.linalg.solve(by_place + by_speed, by_speed @ between[:, axis]))
        return PosePrior(np.stack([level, level, np.linalg.inv(heading)]), np.stack(information), np.stack(mean))

    def fitted(self, levels: ErrorLevels, steadied: Cameras, turned: NDArray[np.float64]) -> ErrorLevels:
        """The levels that agree with what the pictures say.

        Args:
            levels: as stated.
            steadied: the most probable cameras under levels as they were.
            turned: (k, 3, 3), the rotations in front of the reported attitudes.
        """
        t_s = self.cameras.t_s
        angle = rotation_logarithm(turned)
        place = steadied.position_m - self.cameras.position_m
        way = steadied.position_m - self.way_m
        return replace(
            levels,
            heading=_fitted(levels.heading, t_s, angle[:, 2:], _FLOOR_RAD, integrated=False),
            tilt=_fitted(levels.tilt, t_s, angle[:, :2], _FLOOR_RAD, integrated=False),
            horizontal=_fitted(levels.horizontal, t_s, place[:, :2], _FLOOR_M, integrated=False),
            vertical=_fitted(levels.vertical, t_s, place[:, 2:], _FLOOR_M, integrated=False),
            horizontal_velocity=_fitted(levels.horizontal_velocity, t_s, way[:, :2], _FLOOR_M, integrated=True),
            vertical_velocity=_fitted(levels.vertical_velocity, t_s, way[:, 2:], _FLOOR_M, integrated=True),
        )


def _fitted(stated: GaussMarkov, t_s: Vector, error: Matrix, floor: float, *, integrated: bool) -> GaussMarkov:
    """A process of the stated shape and of the size that (k, axes) errors have, constants left out."""
    count = len(t_s)
    waves = int(np.clip(np.ceil(2.0 * _WAVES_PER_S * (t_s[-1] - t_s[0])), 2, count - 1))
    basis = np.cos(np.pi * np.outer((np.arange(count) + 0.5) / count, np.arange(1, waves + 1)))
    basis /= np.linalg.norm(basis, axis=0)
    unit = replace(stated, sigma=1.0)
    shape = unit.integral_covariance(t_s) if integrated else unit.covariance(t_s)
    sigma = max(stated.sigma, 1e-6)
    covariance = basis.T @ shape @ basis + (floor / sigma) ** 2 * np.eye(waves)
    seen = basis.T @ error
    square = float(np.einsum("ka,ka->", seen, np.linalg.solve(covariance, seen)))
    # Scale, turn and a slow line have been fitted to these very errors: about two numbers an axis are used up.
    number = max(error.shape[1] * (waves - 2), 1)
    return replace(stated, sigma=float(np.sqrt((square + _PRIOR_ROWS * sigma**2) / (number + _PRIOR_ROWS))))
