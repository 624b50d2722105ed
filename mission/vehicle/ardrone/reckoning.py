"""Where the AR.Drone is: dead reckoning from navdata's velocity and heading, slowly anchored to GPS where it has a fix.

The drone measures its velocity itself (camera below, accelerometers) and its height (ultrasound, pressure), at up to
200 Hz. Integrated, that is smooth and drifts; GPS is rough and does not. The position's error is taken as a random walk
(`WALK_M_PER_SQRT_S` a axis) that GPS observes, so within a pattern the path keeps the velocity's smoothness.

Frame: ENU whose zero is where navdata was first heard, up from the ground under the drone. The heading is psi, brought
to the magnetometer's fused heading where that is calibrated, plus the declination where that is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mission.geodesy import enu_to_geodetic, geodetic_to_enu
from mission.pose.buffer import world_from_body
from mission.records import GeodeticOrigin, Vector
from mission.vehicle.ardrone.navdata import Navdata
from mission.vehicle.ardrone.navdata_options import DroneTime, Gps

WALK_M_PER_SQRT_S = 0.1
"""Of the integrated velocity, per axis: 0.1 m/s of velocity error that changes within half a second."""
GPS_SIGMA_M = 2.5
"""Per axis for each unit of HDOP; what a single-frequency receiver without augmentation gives."""
GPS_CORRELATION_S = 30.0
"""GPS errors last: a fix every 0.2 s is no new information."""
MAX_STEP_S = 0.3
"""Across a larger gap the velocity in between is not known."""
_CLIMB_S = 0.15
_HEADING_S = 5.0
_LONGEST_GAP_S = 60.0
_RESTART = 50
"""A sequence number lower than the last by more than this means that the drone was restarted."""


@dataclass(frozen=True, slots=True, eq=False)
class Reckoned:
    """The pose after one navdata packet."""

    drone_s: float
    """On the drone's own clock, unwrapped; the arrival where it tells no time."""
    position_enu_m: Vector
    """(3,)."""
    velocity_enu_m_s: Vector
    """(3,)."""
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    """Clockwise from north, true or magnetic or neither: see `Reckoning.heading`."""
    restarted: bool
    """Whether the drone began anew, so that earlier poses mean nothing."""

    @property
    def world_from_body_wxyz(self) -> Vector:
        """(4,)."""
        return world_from_body(self.roll_rad, self.pitch_rad, self.yaw_rad)


class Reckoning:
    """Integrates the packets of one drone, in their own order and each once.

    Args:
        declination_rad: added to magnetic headings, east positive.
        velocity_scale: true over reported horizontal speed.
    """

    def __init__(self, declination_rad: float = 0.0, velocity_scale: float = 1.0) -> None:
        self._scale = velocity_scale
        self.origin: GeodeticOrigin | None = None
        """Fixed at the first GPS fix."""
        self.variance_m2 = 0.0
        """Of the horizontal position per axis: since the start without GPS, of the place on earth with it."""
        self.magnetic = False
        """Whether the heading is the magnetometer's."""
        self._declination_rad = declination_rad
        self._sequence: int | None = None
        self._last: Reckoned | None = None
        self._clock_s: float | None = None
        self._turns = 0
        self._dead_m = np.zeros(2)
        self._offset_m = np.zeros(2)
        self._up_m = 0.0
        self._climb_m_s = 0.0
        self._heading_offset_rad: float | None = None
        self._gps_frame: int | None = None

    def add(self, navdata: Navdata, arrived_s: float) -> Reckoned | None:
        """The pose after this packet; None for one that is old, a double, or has no demo option."""
        if navdata.demo is None:
            return None
        restarted = self._restarted(navdata.sequence)
        if not restarted and self._sequence is not None and navdata.sequence <= self._sequence:
            return None
        self._sequence = navdata.sequence
        demo = navdata.demo
        drone_s = self._unwrapped(navdata.time, arrived_s)
        if self._last is not None and not 0.0 < drone_s - self._last.drone_s < _LONGEST_GAP_S:
            # The clock was set anew, or begins to be told: in bootstrap and demo mode it is not.
            restarted = True
        if restarted:
            self._begin_anew()
            drone_s = self._unwrapped(navdata.time, arrived_s)
        last = self._last
        dt = 0.0 if last is None else drone_s - last.drone_s
        yaw = self._heading(navdata, dt)
        forward, right = (self._scale * speed for speed in demo.velocity_m_s[:2])
        east = forward * math.sin(yaw) + right * math.cos(yaw)
        north = forward * math.cos(yaw) - right * math.sin(yaw)
        velocity = np.array([east, north])
        if last is None:
            self._up_m = demo.altitude_m
        else:
            mean = velocity if dt > MAX_STEP_S else 0.5 * (velocity + last.velocity_enu_m_s[:2])
            self._dead_m = self._dead_m + mean * dt
            # Over a gap nothing was measured: the drone may have gone at any speed of the order of the one it had.
            lost = (0.5 * dt) ** 2 if dt > MAX_STEP_S else 0.0
            self.variance_m2 += WALK_M_PER_SQRT_S**2 * dt + lost
            self._follow_height(demo.altitude_m, dt)
        if navdata.gps is not None:
            self._anchor(navdata.gps)
        place = np.array([*(self._dead_m + self._offset_m), self._up_m])
        speed = np.array([east, north, self._climb_m_s])
        self._last = Reckoned(drone_s, place, speed, demo.roll_rad, demo.pitch_rad, yaw, restarted)
        return self._last

    def _restarted(self, sequence: int) -> bool:
        return self._sequence is not None and sequence < self._sequence - _RESTART

    def _begin_anew(self) -> None:
        self._last = self._clock_s = self._heading_offset_rad = None
        self.variance_m2 += 1.0
        self._turns = 0

    def _unwrapped(self, time: DroneTime | None, arrived_s: float) -> float:
        if time is None:
            return arrived_s
        if self._clock_s is not None and time.seconds < self._clock_s - DroneTime.WRAP_S / 2.0:
            self._turns += 1
        self._clock_s = time.seconds
        return time.seconds + self._turns * DroneTime.WRAP_S

    def _heading(self, navdata: Navdata, dt: float) -> float:
        psi = 0.0 if navdata.demo is None else navdata.demo.yaw_rad
        magneto = navdata.magneto
        if magneto is not None and magneto.calibrated:
            apart = math.remainder(magneto.fused_heading_rad - psi, math.tau)
            if self._heading_offset_rad is None:
                self._heading_offset_rad = apart
            gain = 1.0 - math.exp(-dt / _HEADING_S)
            self._heading_offset_rad += gain * math.remainder(apart - self._heading_offset_rad, math.tau)
            self.magnetic = True
        offset = 0.0 if self._heading_offset_rad is None else self._heading_offset_rad + self._declination_rad
        return math.remainder(psi + offset, math.tau)

    def _follow_height(self, altitude_m: float, dt: float) -> None:
        """An alpha-beta filter, critically damped: the drone's own vertical speed is zero in many firmwares."""
        fade = math.exp(-dt / _CLIMB_S)
        predicted = self._up_m + self._climb_m_s * dt
        innovation = altitude_m - predicted
        self._up_m = predicted + (1.0 - fade**2) * innovation
        self._climb_m_s += (1.0 - fade) ** 2 * innovation / dt

    def _anchor(self, gps: Gps) -> None:
        if not gps.fixed or gps.frame_ms == self._gps_frame:
            return
        self._gps_frame = gps.frame_ms
        sigma = GPS_SIGMA_M * gps.hdop
        if self.origin is None:
            # The local zero stays where it is: the origin is the place on earth that is there.
            here = GeodeticOrigin(gps.lat_deg, gps.lon_deg, gps.elevation_m - self._up_m, "amsl")
            self.origin = _moved(here, -(self._dead_m + self._offset_m))
            self.variance_m2 = sigma**2
            return
        place = geodetic_to_enu(gps.lat_deg, gps.lon_deg, self.origin.alt_m, self.origin)[:2]
        rough = sigma**2 * GPS_CORRELATION_S / 0.2
        gain = self.variance_m2 / (self.variance_m2 + rough)
        self._offset_m = self._offset_m + gain * (place - self._dead_m - self._offset_m)
        self.variance_m2 = max((1.0 - gain) * self.variance_m2, (0.5 * sigma) ** 2)


def _moved(origin: GeodeticOrigin, by_m: Vector) -> GeodeticOrigin:
    """The origin, moved by east and north metres."""
    place = enu_to_geodetic(np.array([by_m[0], by_m[1], 0.0]), origin)
    return GeodeticOrigin(place.lat_deg, place.lon_deg, origin.alt_m, origin.datum)
