"""The flight of a case, stepped without real time: where the aircraft really is, and what its autopilot reports.

The simulated autopilot's vehicle (dynamics, state estimate with its errors, position and attitude loops) follows the
pattern's setpoints as the mission's pilot sends them. The heading follows the person as the mission's aim does: the aim
closes its loop through the picture, so it is right in the world whatever the compass says, but for its own error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mission.pose.buffer import Pose, PoseBuffer, heading, world_from_body
from mission.records import GeodeticOrigin, Matrix, Vector
from mission.vehicle.drone import Path
from mission.vehicle.path_follower import setpoint_at
from sitl.autopilot import AutopilotConfig, Wind
from sitl.autopilot.flavour import PX4
from sitl.autopilot.flight_controller import Demand
from sitl.autopilot.flight_stack import TICK_S
from sitl.autopilot.local_frame import LocalFrame
from sitl.autopilot.rotation import Vec, wrap
from sitl.autopilot.vehicle import Vehicle
from sitl.evaluation.rendered.case import Case

SETTLE_S = 3.0
"""Hover before anything is seen."""
TURN_S = 2.6
"""From the first frame, with the person beside the middle, until the pattern begins."""
BESIDE_RAD = math.radians(20.0)
"""How far beside the middle the person is at first."""
_WAIT_S = 0.3
"""Of `TURN_S`, before the turn begins."""
_AFTER_S = 1.0
"""Flown on after the pattern, so that reports reach beyond its last frame."""
_SETPOINT_TICKS = 6
_REPORT_TICKS = 4
"""50 Hz, as the mission asks for."""
_AIM_ERROR_RAD = math.radians(1.5)

Bearing = Callable[[float, Vec], float]
"""True azimuth of the person at a time from a place, clockwise from north."""


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """A finished flight. Times are the program's, seconds; the pattern begins at 0."""

    true: PoseBuffer
    reported: PoseBuffer
    covariance: tuple[Matrix, Matrix]
    """Of position and attitude, as the mission takes them to be."""

    def true_pose(self, t_s: float) -> Pose:
        """Where the aircraft really was.

        Raises:
            ValueError: the flight does not reach there.
        """
        pose = self.true.at(t_s, np.zeros((3, 3)), np.zeros((3, 3)))
        if pose is None:
            raise ValueError(f"the flight has no time {t_s:.2f} s")
        return pose

    def pose_at(self, t_s: float) -> Pose | None:
        """Where the autopilot says that it was; None where nothing was reported."""
        return self.reported.at(t_s, *self.covariance)


def fly(
    case: Case,
    path: Path,
    azimuth_rad: float,
    height_m: float,
    home: GeodeticOrigin,
    bearing: Bearing,
    covariance: tuple[Matrix, Matrix],
) -> Flown:
    """Fly the turn to the person and the pattern.

    Args:
        case: noise preset and seed.
        path: the pattern, from where the aircraft hovers.
        azimuth_rad: of the person when the pattern begins.
        height_m: above the ground.
        home: of the local frame.
        bearing: where the person is to be aimed at.
        covariance: handed through.
    """
    rng = np.random.default_rng([case.seed, 5])
    towards = rng.uniform(0.0, 2.0 * math.pi)
    mean = rng.uniform(0.0, 2.0)
    wind = Wind((mean * math.sin(towards), mean * math.cos(towards), 0.0), 0.3 * mean)
    side = 1.0 if rng.uniform() < 0.5 else -1.0
    off = wrap(azimuth_rad + side * BESIDE_RAD)
    config = AutopilotConfig(noise=case.noise, seed=case.seed, home=home, heading_rad=off, wind=wind)
    vehicle = Vehicle(config, PX4, TICK_S, rng)
    vehicle.place((0.0, 0.0, height_m))
    place = LocalFrame(home.lat_deg, home.lon_deg, home.alt_m, config.geoid_separation_m)
    phases = rng.uniform(0.0, 2.0 * math.pi, 2)
    rest = np.array([0.0, 0.0, -height_m])
    span = PoseBuffer(keep_s=120.0, max_messages=40000), PoseBuffer(keep_s=120.0, max_messages=40000)
    flown = Flown(*span, covariance)
    first, last = -round((SETTLE_S + TURN_S) / TICK_S), round((path.duration_s + _AFTER_S) / TICK_S)
    demand = Demand((0.0, 0.0, height_m), (0.0, 0.0, 0.0), yaw=off)
    for tick in range(first, last + 1):
        t_s = tick * TICK_S
        _note_truth(flown.true, vehicle, t_s)
        if tick % _REPORT_TICKS == 0:
            _report(flown.reported, vehicle, place, t_s)
        if tick % _SETPOINT_TICKS == 0:
            yaw = off if t_s < -TURN_S + _WAIT_S else _aim(vehicle, bearing, t_s, phases)
            setpoint = setpoint_at(path, t_s, rest)
            demand = Demand(_enu(setpoint.position_ned_m), _enu(setpoint.velocity_ned_m_s), yaw=yaw)
        vehicle.step(demand, math.inf)
    return flown


def _aim(vehicle: Vehicle, bearing: Bearing, t_s: float, phases: Vector) -> float:
    """The heading to ask for, in the autopilot's own terms."""
    error = _AIM_ERROR_RAD * (0.7 * math.sin(1.7 * t_s + phases[0]) + 0.5 * math.sin(3.1 * t_s + phases[1]))
    compass = vehicle.estimate.heading - heading(vehicle.truth(t_s).world_from_body_wxyz)
    return wrap(bearing(t_s, vehicle.airframe.position) + error + compass)


def _note_truth(buffer: PoseBuffer, vehicle: Vehicle, t_s: float) -> None:
    truth = vehicle.truth(t_s)
    buffer.add_position(t_s, truth.position_enu_m, truth.velocity_enu_m_s)
    buffer.add_attitude(t_s, truth.world_from_body_wxyz)


def _report(buffer: PoseBuffer, vehicle: Vehicle, place: LocalFrame, t_s: float) -> None:
    """GLOBAL_POSITION_INT and ATTITUDE: whole units of 1e-7 degrees, mm, cm/s and ms."""
    lat, lon, alt = place.geodetic(vehicle.estimate.position)
    where = place.enu(round(lat * 1e7) / 1e7, round(lon * 1e7) / 1e7, round(alt * 1e3) / 1e3)
    speed = [round(100.0 * v) / 100.0 for v in vehicle.estimate.velocity]
    stamp_s = math.floor(1e3 * t_s + 1e-6) / 1e3
    buffer.add_position(stamp_s, np.array(where), np.array(speed))
    roll, pitch, yaw = (float(np.float32(angle)) for angle in vehicle.euler)
    buffer.add_attitude(stamp_s, world_from_body(roll, pitch, yaw))


def _enu(ned: Vector) -> Vec:
    return float(ned[1]), float(ned[0]), -float(ned[2])
