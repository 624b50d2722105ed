"""The navdata options that are read, each laid out as in `navdata_common.h` of the AR.Drone SDK 2.0 (packed).

Where the SDK's comments and the drone differ, the drone counts, as its clients have found it:

- demo.altitude is in millimetres (the SDK says centimetres; node-ar-drone divides by 1000 for metres).
- ctrl_state holds the major state in its upper and the minor one in its lower 16 bits.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar


class Control(IntEnum):
    """Major control state (CTRL_STATES)."""

    DEFAULT = 0
    INIT = 1
    LANDED = 2
    FLYING = 3
    HOVERING = 4
    TEST = 5
    TAKING_OFF = 6
    GOING_TO_FIX = 7
    LANDING = 8
    LOOPING = 9


@dataclass(frozen=True, slots=True)
class Demo:
    """NAVDATA_DEMO, tag 0: what every flight needs."""

    control: int
    """`Control`, or a number that is not known here."""
    control_minor: int
    battery_fraction: float
    pitch_rad: float
    """theta, positive with the nose up."""
    roll_rad: float
    """phi, positive with the right side down."""
    yaw_rad: float
    """psi, clockwise."""
    altitude_m: float
    """Above the ground under it."""
    velocity_m_s: tuple[float, float, float]
    """Forward, right, down in the level frame that turns with the heading."""

    SIZE: ClassVar[int] = 144
    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HHIfffifff")

    @classmethod
    def decode(cls, data: bytes) -> Demo | None:
        """From the option's data; None when a value is not a finite number."""
        minor, major, battery, theta, phi, psi, altitude, vx, vy, vz = cls._LAYOUT.unpack_from(data)
        if not _finite(theta, phi, psi, vx, vy, vz):
            return None
        turn = math.radians(1e-3)
        fraction = min(100, battery) / 100.0
        speed = (vx * 1e-3, vy * 1e-3, vz * 1e-3)
        return cls(major, minor, fraction, theta * turn, phi * turn, psi * turn, altitude * 1e-3, speed)


@dataclass(frozen=True, slots=True)
class DroneTime:
    """NAVDATA_TIME, tag 1: 11 bits of seconds, 21 bits of microseconds; starts anew after 2048 s."""

    seconds: float

    SIZE: ClassVar[int] = 4
    WRAP_S: ClassVar[float] = 2048.0

    @classmethod
    def decode(cls, data: bytes) -> DroneTime | None:
        """From the option's data."""
        (bits,) = struct.unpack_from("<I", data)
        return cls((bits >> 21) + (bits & 0x1FFFFF) * 1e-6)


@dataclass(frozen=True, slots=True)
class Altitude:
    """NAVDATA_ALTITUDE, tag 10."""

    vision_m: float
    vertical_speed_m_s: float
    reference_m: float
    raw_m: float
    """Of the ultrasound."""

    SIZE: ClassVar[int] = 52
    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<ifii")

    @classmethod
    def decode(cls, data: bytes) -> Altitude | None:
        """From the option's data; None when a value is not a finite number."""
        vision, speed, reference, raw = cls._LAYOUT.unpack_from(data)
        if not _finite(speed):
            return None
        return cls(vision * 1e-3, speed * 1e-3, reference * 1e-3, raw * 1e-3)


@dataclass(frozen=True, slots=True)
class Magneto:
    """NAVDATA_MAGNETO, tag 22."""

    fused_heading_rad: float
    """heading_fusion_unwrapped, of magnetometer and gyrometers: clockwise from magnetic north, any number of turns."""
    calibrated: bool

    SIZE: ClassVar[int] = 59
    """Older firmware ends after magneto_radius and two errors; what is needed ends with magneto_state."""
    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<3h9f3fBI")

    @classmethod
    def decode(cls, data: bytes) -> Magneto | None:
        """From the option's data; None when a value is not a finite number."""
        *_, fused, calibrated, _state = cls._LAYOUT.unpack_from(data)
        return cls(math.radians(fused), bool(calibrated)) if _finite(fused) else None


@dataclass(frozen=True, slots=True)
class Wifi:
    """NAVDATA_WIFI, tag 26."""

    link_quality: int
    """As the drone tells it; many firmwares always say 0."""

    SIZE: ClassVar[int] = 4

    @classmethod
    def decode(cls, data: bytes) -> Wifi | None:
        """From the option's data."""
        return cls(*struct.unpack_from("<I", data))


@dataclass(frozen=True, slots=True)
class Gps:
    """NAVDATA_GPS, tag 27, of firmware 2.4.1 and later with the flight recorder plugged in (the GPS edition)."""

    lat_deg: float
    lon_deg: float
    elevation_m: float
    """Above mean sea level."""
    hdop: float
    data_available: bool
    state: int
    """1 with a fix (as paparazzi reads it)."""
    satellites: int
    plugged: bool
    frame_ms: int
    """lastFrameTimestamp: changes with each new position."""

    SIZE: ClassVar[int] = 212
    """Up to firmwareStatus; newer firmware adds more."""
    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<4dIii4dI10f2dfIfffffI24si")

    @classmethod
    def decode(cls, data: bytes) -> Gps | None:
        """From the option's data; None when a value is not a finite number."""
        fields = cls._LAYOUT.unpack_from(data)
        lat, lon, elevation, hdop = fields[:4]
        if not _finite(lat, lon, elevation, hdop):
            return None
        frame_ms, satellites, plugged = fields[25], fields[31], fields[33]
        return cls(lat, lon, elevation, hdop, bool(fields[4]), fields[11], satellites, bool(plugged), frame_ms)

    @property
    def fixed(self) -> bool:
        """Whether it is a position that can be believed."""
        placed = abs(self.lat_deg) <= 90.0 and abs(self.lon_deg) <= 180.0 and (self.lat_deg, self.lon_deg) != (0.0, 0.0)
        return self.plugged and self.data_available and self.state == 1 and placed and 0.0 < self.hdop < 10.0


Option = Demo | DroneTime | Altitude | Magneto | Wifi | Gps

OPTIONS: dict[int, type[Option]] = {0: Demo, 1: DroneTime, 10: Altitude, 22: Magneto, 26: Wifi, 27: Gps}
"""By tag."""
MASK = sum(1 << tag for tag in OPTIONS)
"""general:navdata_options for these."""


def _finite(*values: float) -> bool:
    return all(math.isfinite(value) for value in values)
