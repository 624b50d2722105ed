"""Navdata: what the AR.Drone reports over UDP 5554 (AR.Drone SDK 2.0, `navdata_common.h` and Developer Guide 7).

A packet is a header of 16 bytes (0x55667788, state, sequence, vision flag), then options (tag, size with these four
bytes, data), the last of them the checksum: the sum of all bytes before it. All is little-endian. In bootstrap the
drone sends the header and the checksum only.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from enum import IntFlag

from mission.vehicle.ardrone.navdata_options import OPTIONS, Altitude, Demo, DroneTime, Gps, Magneto, Option, Wifi

HEADER = 0x55667788
CHECKSUM_TAG = 0xFFFF
MAX_PACKET = 4096
"""NAVDATA_MAX_SIZE."""
WAKE_UP = b"\x01\x00\x00\x00"
"""Sent to the drone's navdata port: from then on it sends navdata to where that came from."""

_HEAD = struct.Struct("<IIII")
_OPTION = struct.Struct("<HH")
_CHECKSUM = struct.Struct("<I")


class DroneState(IntFlag):
    """Bits of the header's state (`config.h`, def_ardrone_state_mask_t), those that are of use here."""

    FLYING = 1 << 0
    COMMAND_ACK = 1 << 6
    NAVDATA_DEMO = 1 << 10
    NAVDATA_BOOTSTRAP = 1 << 11
    MOTOR_PROBLEM = 1 << 12
    COMMUNICATION_LOST = 1 << 13
    SOFTWARE_FAULT = 1 << 14
    BATTERY_LOW = 1 << 15
    USER_EMERGENCY_LANDING = 1 << 16
    MAGNETOMETER_NEEDS_CALIBRATION = 1 << 18
    ANGLES_OUT_OF_RANGE = 1 << 19
    TOO_MUCH_WIND = 1 << 20
    ULTRASOUND_DEAF = 1 << 21
    CUTOUT = 1 << 22
    COMMUNICATION_WATCHDOG = 1 << 30
    EMERGENCY = 1 << 31


@dataclass(frozen=True, slots=True)
class Navdata:
    """One packet; an option that it did not hold is None."""

    state: int
    """Bits of `DroneState`, and others."""
    sequence: int
    demo: Demo | None = None
    time: DroneTime | None = None
    altitude: Altitude | None = None
    magneto: Magneto | None = None
    wifi: Wifi | None = None
    gps: Gps | None = None
    unknown: tuple[int, ...] = ()
    """Tags that were skipped."""

    def says(self, bit: DroneState) -> bool:
        """Whether the state has this bit."""
        return bool(self.state & bit)


@dataclass(frozen=True, slots=True)
class Malformed:
    """A datagram that is no navdata, and why."""

    reason: str


def decode_navdata(data: bytes) -> Navdata | Malformed:
    """Read a datagram; never raises, whatever comes.

    Options that are not known are skipped. An option longer than is known here is taken (the SDK only ever adds at the
    end); a shorter one, a wrong checksum, or anything after the checksum makes the whole packet malformed.
    """
    if len(data) < _HEAD.size:
        return Malformed(f"{len(data)} bytes, less than a header")
    if len(data) > MAX_PACKET:
        return Malformed(f"{len(data)} bytes, more than {MAX_PACKET}")
    header, state, sequence, _ = _HEAD.unpack_from(data)
    if header != HEADER:
        return Malformed(f"header 0x{header:08x}")
    found: dict[type[Option], Option] = {}
    unknown: list[int] = []
    at = _HEAD.size
    while True:
        if at + _OPTION.size > len(data):
            return Malformed("no checksum at the end")
        tag, size = _OPTION.unpack_from(data, at)
        if size < _OPTION.size or at + size > len(data):
            return Malformed(f"option {tag} says {size} bytes, {len(data) - at} are left")
        if tag == CHECKSUM_TAG:
            break
        kind = OPTIONS.get(tag)
        if kind is None:
            unknown.append(tag)
        elif size - _OPTION.size < kind.SIZE:
            return Malformed(f"option {kind.__name__} has {size - _OPTION.size} bytes, {kind.SIZE} are needed")
        else:
            option = kind.decode(data[at + _OPTION.size : at + size])
            if option is None:
                return Malformed(f"option {kind.__name__} has a value that is not a number")
            found.setdefault(kind, option)
        at += size
    wrong = _checksum_wrong(data, at)
    if wrong:
        return Malformed(wrong)
    return _gathered(Navdata(state, sequence, unknown=tuple(unknown)), found)


def _checksum_wrong(data: bytes, at: int) -> str:
    if at + _OPTION.size + _CHECKSUM.size != len(data):
        return "the checksum is not the end"
    (told,) = _CHECKSUM.unpack_from(data, at + _OPTION.size)
    summed = sum(data[:at]) & 0xFFFFFFFF
    return "" if told == summed else f"checksum {told}, the bytes sum to {summed}"


def _gathered(packet: Navdata, found: dict[type[Option], Option]) -> Navdata:
    for option in found.values():
        match option:
            case Demo():
                packet = replace(packet, demo=option)
            case DroneTime():
                packet = replace(packet, time=option)
            case Altitude():
                packet = replace(packet, altitude=option)
            case Magneto():
                packet = replace(packet, magneto=option)
            case Wifi():
                packet = replace(packet, wifi=option)
            case Gps():
                packet = replace(packet, gps=option)
    return packet
