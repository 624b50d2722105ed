"""Reads the two recorded flights in tests/data/tlogs (8-byte big-endian microseconds, then the frame)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

TLOGS = Path(__file__).parents[1] / "data" / "tlogs"
ARDUCOPTER = TLOGS / "arducopter-out-and-back.tlog"
PX4 = TLOGS / "px4-out-and-back.tlog"


def messages(path: Path) -> Iterator[tuple[float, Any]]:
    """Arrival time (seconds, UNIX) and decoded message of each frame."""
    for arrived_s, frame in frames(path):
        yield arrived_s, mavlink.MAVLink(None).decode(bytearray(frame))


def frames(path: Path) -> Iterator[tuple[float, bytes]]:
    """Arrival time (seconds, UNIX) and the bytes of each frame."""
    data = path.read_bytes()
    at = 0
    while at < len(data):
        (microseconds,) = struct.unpack_from(">Q", data, at)
        at += 8
        if data[at] == mavlink.PROTOCOL_MARKER_V2:
            length = 12 + data[at + 1] + (13 if data[at + 2] & mavlink.MAVLINK_IFLAG_SIGNED else 0)
        else:
            length = 8 + data[at + 1]
        yield microseconds * 1e-6, data[at : at + length]
        at += length
