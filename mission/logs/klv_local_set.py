"""The fields of MISB ST 0601 (UAS datalink local set) that place a camera, from one KLV packet."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

KEY: Final = bytes.fromhex("060e2b34020b01010e01030101000000")
_CHECKSUM_TAG: Final = 1
_TIME_TAG: Final = 2
_US: Final = 1e-6

# Tag: bytes, signed, smallest, largest (for signed ones -largest), ST 0601 section 8.
_RANGES: Final[dict[int, tuple[int, bool, float, float]]] = {
    5: (2, False, 0.0, 360.0),
    6: (2, True, -20.0, 20.0),
    7: (2, True, -50.0, 50.0),
    13: (4, True, -90.0, 90.0),
    14: (4, True, -180.0, 180.0),
    15: (2, False, -900.0, 19000.0),
    16: (2, False, 0.0, 180.0),
    18: (4, False, 0.0, 360.0),
    19: (4, True, -180.0, 180.0),
    20: (4, False, 0.0, 360.0),
    75: (2, False, -900.0, 19000.0),
    79: (2, True, -327.0, 327.0),
    80: (2, True, -327.0, 327.0),
    90: (4, True, -90.0, 90.0),
    91: (4, True, -90.0, 90.0),
}


class KlvError(ValueError):
    """The packet is cut, or its checksum is wrong."""


@dataclass(frozen=True, slots=True)
class UasLocalSet:
    """One packet. Angles in degrees; None where the field is not there, or says that it is out of range."""

    time_s: float | None
    """MISP time, seconds since 1970 (UTC of most writers)."""
    heading_deg: float | None
    pitch_deg: float | None
    roll_deg: float | None
    lat_deg: float | None
    lon_deg: float | None
    amsl_m: float | None
    ellipsoid_m: float | None
    hfov_deg: float | None
    sensor_azimuth_deg: float | None
    """Relative to the platform, clockwise, like the next two."""
    sensor_elevation_deg: float | None
    sensor_roll_deg: float | None
    north_m_s: float | None
    east_m_s: float | None


def packets(data: bytes) -> Iterator[bytes]:
    """The local sets in some bytes, each with its key; what is not whole at the end is left out."""
    at = data.find(KEY)
    while at >= 0:
        try:
            length, begin = _ber_length(data, at + len(KEY))
        except KlvError:
            return
        end = begin + length
        if end > len(data):
            return
        yield data[at:end]
        at = data.find(KEY, end)


def parse_local_set(packet: bytes) -> UasLocalSet:
    """One packet, key and all.

    Raises:
        KlvError: it is cut, of another kind, or its checksum is wrong.
    """
    if not packet.startswith(KEY):
        raise KlvError("no UAS datalink local set")
    length, at = _ber_length(packet, len(KEY))
    end = at + length
    if end > len(packet):
        raise KlvError("the packet is cut")
    fields: dict[int, bytes] = {}
    while at < end:
        tag, at = _oid(packet, at, end)
        size, at = _ber_length(packet, at)
        if at + size > end:
            raise KlvError(f"tag {tag} is cut")
        if tag == _CHECKSUM_TAG and size == 2 and int.from_bytes(packet[at : at + 2], "big") != checksum(packet[:at]):
            raise KlvError("the checksum is wrong")
        fields[tag] = packet[at : at + size]
        at += size
    if _CHECKSUM_TAG not in fields:
        raise KlvError("the checksum is missing")
    time = fields.get(_TIME_TAG, b"")
    full_pitch, full_roll = _number(fields, 90), _number(fields, 91)
    return UasLocalSet(
        time_s=int.from_bytes(time, "big") * _US if len(time) == 8 else None,
        heading_deg=_number(fields, 5),
        pitch_deg=_number(fields, 6) if full_pitch is None else full_pitch,
        roll_deg=_number(fields, 7) if full_roll is None else full_roll,
        lat_deg=_number(fields, 13),
        lon_deg=_number(fields, 14),
        amsl_m=_number(fields, 15),
        ellipsoid_m=_number(fields, 75),
        hfov_deg=_number(fields, 16),
        sensor_azimuth_deg=_number(fields, 18),
        sensor_elevation_deg=_number(fields, 19),
        sensor_roll_deg=_number(fields, 20),
        north_m_s=_number(fields, 79),
        east_m_s=_number(fields, 80),
    )


def checksum(before: bytes) -> int:
    """The 16-bit sum over everything from the key to the checksum's own length, even bytes shifted by 8."""
    high, low = sum(before[::2]), sum(before[1::2])
    return (high * 256 + low) & 0xFFFF


def _number(fields: dict[int, bytes], tag: int) -> float | None:
    raw = fields.get(tag)
    size, signed, low, high = _RANGES[tag]
    if raw is None or len(raw) != size:
        return None
    value = int.from_bytes(raw, "big", signed=signed)
    most = float((1 << (8 * size - 1)) - 1 if signed else (1 << (8 * size)) - 1)
    if signed:
        return None if value < -most else value / most * high
    return low + value / most * (high - low)


def _ber_length(data: bytes, at: int) -> tuple[int, int]:
    """Length and where what it counts begins (BER: short form, or the number of bytes of the long one)."""
    if at >= len(data):
        raise KlvError("a length is cut")
    first = data[at]
    if first < 0x80:
        return first, at + 1
    size = first & 0x7F
    if not 1 <= size <= struct.calcsize("Q") or at + 1 + size > len(data):
        raise KlvError("a length is impossible")
    return int.from_bytes(data[at + 1 : at + 1 + size], "big"), at + 1 + size


def _oid(data: bytes, at: int, end: int) -> tuple[int, int]:
    tag = 0
    while at < end:
        byte = data[at]
        tag, at = (tag << 7) | (byte & 0x7F), at + 1
        if byte < 0x80:
            return tag, at
    raise KlvError("a tag is cut")
