"""What a flight log tells of the camera: its positions, its attitude or none, on one clock, with how good they are."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mission.errors import LogError
from mission.pose.buffer import Pose, PoseAt, PoseBuffer
from mission.records import GeodeticOrigin, Matrix, NoiseModel, Vector

LogKind = Literal["tlog", "dataflash", "ulog", "dji-srt", "misb-klv", "csv"]
Clock = Literal["vehicle", "video"]
"""What a log's seconds count from: the vehicle's start, or the video's first frame."""

LEAST_GAP_S = 0.3
MOST_GAP_S = 1.5
"""No pose is interpolated across a longer gap, whatever the log's usual rate."""
UNKNOWN_ACCURACY_M = 4.6
"""Horizontal, 1-sigma of the radius, of a plain GPS receiver (95 % within 8 m: SPS performance standard, 2020)."""
_GAP_FACTOR = 2.6
_TURN_ACCELERATION_RAD_S2 = 0.5
"""Of an aircraft that carries a camera, rms: what an attitude between two reports may miss."""


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """Where the aircraft was."""

    t_s: Vector
    """(n,), ascending."""
    enu_m: Matrix
    """(n, 3), relative to the log's origin."""
    velocity_m_s: Matrix
    """(n, 3), ENU."""


@dataclass(frozen=True, slots=True, eq=False)
class Attitudes:
    """How something was turned."""

    t_s: Vector
    """(n,), ascending."""
    world_from_body_wxyz: Matrix
    """(n, 4), unit quaternions from forward-right-down to ENU."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseLog:
    """One flight's log, whatever it was written by."""

    kind: LogKind
    clock: Clock
    origin: GeodeticOrigin
    positions: Positions
    aircraft: Attitudes | None
    """Of the airframe; None where the log does not tell."""
    gimbal: Attitudes | None
    """Of the camera on its gimbal, as of a body whose forward axis is the lens's axis; None without a gimbal."""
    noise: NoiseModel
    """How good the poses are within a few seconds, pose fields only."""
    utc_at_zero_s: float | None = None
    """Seconds since 1970, UTC, at the log's time 0; None where the log does not tell."""
    accuracy_m: float | None = None
    """Absolute horizontal accuracy that the log states, 1-sigma."""
    hfov_rad: float | None = None
    """Full horizontal angle of view, where the log tells and it did not change."""
    zoomed: bool = False
    """Whether the angle of view changed during the flight."""
    take_off_up_m: float | None = None
    """Up coordinate of the take-off point, where the log tells heights above it."""
    geoid_separation_m: float | None = None
    """Ellipsoid height minus altitude above mean sea level."""
    notes: tuple[str, ...] = field(default=())
    """What was odd, for people."""

    @property
    def pointing(self) -> Attitudes | None:
        """What the camera's attitude follows from: the gimbal where there is one, else the airframe."""
        return self.gimbal if self.gimbal is not None else self.aircraft

    @property
    def first_s(self) -> float:
        """Time of the first position."""
        return float(self.positions.t_s[0])

    @property
    def last_s(self) -> float:
        """Time of the last position."""
        return float(self.positions.t_s[-1])

    def gaps(self) -> tuple[tuple[float, float], ...]:
        """Time spans inside the log across which there is no pose."""
        found: list[tuple[float, float]] = []
        for series in (self.positions, self.pointing):
            if series is not None:
                limit = usual_gap_s(series.t_s)
                at = np.flatnonzero(np.diff(series.t_s) > limit)
                found += [(float(series.t_s[i]), float(series.t_s[i + 1])) for i in at]
        return tuple(sorted(found))

    def pose_at(self) -> PoseAt:
        """The camera carrier's pose at a time of the log; None across gaps and outside.

        With a gimbal the carrier is a body that looks where the lens looks: the camera's mounting on it is straight
        ahead.

        Raises:
            LogError: the log tells no attitude.
        """
        pointing = self.pointing
        if pointing is None:
            raise LogError(
                "the log tells neither the aircraft's attitude nor the gimbal's",
                "Give a log that does (a flight record as CSV, or the controller's log).",
            )
        gap = max(usual_gap_s(self.positions.t_s), usual_gap_s(pointing.t_s))
        buffer = PoseBuffer(gap, keep_s=math.inf, max_messages=sys.maxsize)
        for t_s, place, speed in zip(
            self.positions.t_s.tolist(), self.positions.enu_m, self.positions.velocity_m_s, strict=True
        ):
            buffer.add_position(t_s, place, speed)
        for t_s, wxyz in zip(pointing.t_s.tolist(), pointing.world_from_body_wxyz, strict=True):
            buffer.add_attitude(t_s, wxyz)
        noise, horizontal = self.noise, self.accuracy_m or UNKNOWN_ACCURACY_M
        place_m2 = np.diag([horizontal**2 / 2.0, horizontal**2 / 2.0, (1.5 * horizontal) ** 2])
        tilt = noise.tilt_bias_sigma_rad**2 + noise.tilt_sigma_rad**2
        turn_rad2 = np.diag([tilt, tilt, noise.heading_bias_sigma_rad**2 + noise.heading_sigma_rad**2])

        def pose_at(t_s: float) -> Pose | None:
            return buffer.at(t_s, place_m2, turn_rad2)

        return pose_at


def usual_gap_s(t_s: Vector) -> float:
    """The longest time between two reports of a series (n,) that is not a gap: some lost ones at its usual rate."""
    if len(t_s) < 2:
        return LEAST_GAP_S
    return float(np.clip(_GAP_FACTOR * np.median(np.diff(t_s)), LEAST_GAP_S, MOST_GAP_S))


def interpolation_sigma_rad(t_s: Vector) -> float:
    """What an attitude interpolated between reports at these times (n,) misses of a manoeuvre, 1-sigma."""
    if len(t_s) < 2:
        return 0.0
    interval = float(np.median(np.diff(t_s)))
    return _TURN_ACCELERATION_RAD_S2 * interval**2 / 8.0
