"""Navdata: the packets in which an AR.Drone 2.0 reports its state (UDP 5554), little-endian, without padding.

A header of four words (0x55667788, state bits, sequence, vision flag), then options (tag, size with the four bytes of
both, content), the last of them the checksum: the sum of all bytes before it. Source: AR.Drone Developer Guide, SDK
2.0, chapter 7, and ARDroneLib's navdata_common.h; the GPS option, which neither describes, is laid out as Paparazzi's
at_com.h has it (read from the GPS edition's firmware 2.4).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from sitl.ardrone.state import ControlState

HEADER = 0x55667788
_HEADER = struct.Struct("<IIII")
_OPTION = struct.Struct("<HH")
_CHECKSUM = struct.Struct("<HHI")
_DEMO = struct.Struct("<IIfffifffI9f3fII9f3f")
_ALTITUDE = struct.Struct("<ifiiff3fI2fI")
_VISION_DETECT = struct.Struct("<I24I4f36f12f4I")
_MAGNETO = struct.Struct("<3h3f3f3f3fBI3f")
_GPS = struct.Struct("<ddddi8xddddI40xddfIfffffI24Bi108xdHBB24x6d2f72x2f")
_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


class Tag(IntEnum):
    """Options that this aircraft sends."""

    DEMO = 0
    TIME = 1
    EULER_ANGLES = 5
    TRIMS = 7
    ALTITUDE = 10
    VISION_DETECT = 16
    MAGNETO = 22
    WIFI = 26
    GPS = 27
    CHECKSUM = 0xFFFF


@dataclass(frozen=True, slots=True)
class Motion:
    """What the sensors say, in the units of navdata."""

    state: ControlState
    battery_percent: int
    theta_mdeg: float
    """Pitch, positive with the nose up, thousandths of a degree; so the next two."""
    phi_mdeg: float
    """Roll, positive to the right."""
    psi_mdeg: float
    """Heading, clockwise."""
    altitude_mm: int
    vx_mm_s: float
    """Forward, level; so vy to the right and vz down."""
    vy_mm_s: float
    vz_mm_s: float


@dataclass(frozen=True, slots=True)
class Magnetometer:
    """The compass, degrees clockwise from magnetic north, not wrapped."""

    heading_deg: float
    """From the field alone."""
    gyro_heading_deg: float
    fused_heading_deg: float
    field_mg: tuple[float, float, float]
    """In the body's axes, milligauss."""
    calibrated: bool


@dataclass(frozen=True, slots=True)
class GpsFix:
    """The GPS edition's receiver."""

    lat_deg: float
    lon_deg: float
    fused_lat_deg: float
    fused_lon_deg: float
    elevation_m: float
    zero_lat_deg: float
    zero_lon_deg: float
    hdop: float
    satellites: int
    speed_m_s: float
    course_deg: float
    ned_velocity_m_s: tuple[float, float, float]
    accuracy_m: tuple[float, float, float]
    time_of_week_s: float
    week: int
    fixed: bool


def packet(state_bits: int, sequence: int, options: list[bytes], *, vision: int = 1) -> bytes:
    """A whole packet, with its checksum."""
    body = _HEADER.pack(HEADER, state_bits & 0xFFFFFFFF, sequence & 0xFFFFFFFF, vision) + b"".join(options)
    return body + _CHECKSUM.pack(Tag.CHECKSUM, _CHECKSUM.size, sum(body) & 0xFFFFFFFF)


def demo_option(motion: Motion, frames: int) -> bytes:
    """What every flight needs (navdata_demo_t, 148 bytes)."""
    m = motion
    return _option(
        Tag.DEMO,
        _DEMO.pack(
            *(m.state << 16, m.battery_percent, m.theta_mdeg, m.phi_mdeg, m.psi_mdeg, m.altitude_mm),
            *(m.vx_mm_s, m.vy_mm_s, m.vz_mm_s, frames & 0xFFFFFFFF),
            *_IDENTITY,
            *(0.0, 0.0, 0.0, 0, 0),
            *_IDENTITY,
            *(0.0, 0.0, -float(m.altitude_mm)),
        ),
    )


def time_option(since_boot_s: float) -> bytes:
    """Time since the start: 11 bits of seconds above 21 bits of microseconds (navdata_time_t)."""
    seconds, microseconds = divmod(int(since_boot_s * 1e6), 1_000_000)
    return _option(Tag.TIME, struct.pack("<I", (seconds & 0x7FF) << 21 | microseconds))


def euler_option(theta_mdeg: float, phi_mdeg: float) -> bytes:
    """Pitch and roll from the accelerometers alone."""
    return _option(Tag.EULER_ANGLES, struct.pack("<ff", theta_mdeg, phi_mdeg))


def trims_option(theta_deg: float, phi_deg: float) -> bytes:
    """What FTRIM took as level."""
    return _option(Tag.TRIMS, struct.pack("<fff", 0.0, theta_deg, phi_deg))


def altitude_option(altitude_mm: int, vertical_mm_s: float, wanted_mm: int, raw_mm: int) -> bytes:
    """Altitude, climb rate (up), set altitude and what the sonar said (navdata_altitude_t)."""
    words = (altitude_mm, vertical_mm_s, wanted_mm, raw_mm, 0.0, float(altitude_mm), 0.0, 0.0, 0.0, 1, 0.0, 0.0, 1)
    return _option(Tag.ALTITUDE, _ALTITUDE.pack(*words))


def vision_detect_option() -> bytes:
    """No tag is seen (navdata_vision_detect_t, 328 bytes)."""
    return _option(Tag.VISION_DETECT, bytes(_VISION_DETECT.size))


def magneto_option(m: Magnetometer) -> bytes:
    """The compass (navdata_magneto_t, 75 bytes)."""
    raw = [max(-32768, min(32767, round(value))) for value in m.field_mg]
    headings = (m.heading_deg, m.gyro_heading_deg, m.fused_heading_deg)
    field = (*m.field_mg, *m.field_mg, 0.0, 0.0, 0.0)
    words = (*raw, *field, *headings, int(m.calibrated), 2, 480.0, 0.0, 1.0)
    return _option(Tag.MAGNETO, _MAGNETO.pack(*words))


def wifi_option(quality: int) -> bytes:
    """Link quality (navdata_wifi_t)."""
    return _option(Tag.WIFI, struct.pack("<I", quality))


def gps_option(g: GpsFix) -> bytes:
    """The GPS edition's position."""
    satellites = [byte for i in range(12) for byte in ((i + 1, 38) if i < g.satellites else (0, 0))]
    return _option(
        Tag.GPS,
        _GPS.pack(
            *(g.lat_deg, g.lon_deg, g.elevation_m, g.hdop, int(g.fixed)),
            *(g.zero_lat_deg, g.zero_lon_deg, g.fused_lat_deg, g.fused_lon_deg, int(g.fixed)),
            *(1.5 * g.hdop, 1.8 * g.hdop, g.speed_m_s, round(g.time_of_week_s * 1000) & 0xFFFFFFFF),
            *(g.course_deg, g.course_deg, g.accuracy_m[0], 0.5, 38.0, g.satellites, *satellites, 1),
            *(g.time_of_week_s, g.week, int(g.fixed), g.satellites),
            *(*g.ned_velocity_m_s, *g.accuracy_m, 0.5, 1e-6, 35.0, 101325.0),
        ),
    )


def _option(tag: Tag, content: bytes) -> bytes:
    return _OPTION.pack(tag, _OPTION.size + len(content)) + content
