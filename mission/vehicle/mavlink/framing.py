"""Cuts bytes from a link into MAVLink frames, without decoding what nobody wants."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.command_cancel import COMMAND_CANCEL, CommandCancel

MESSAGE_IDS: dict[str, int] = {m.msgname: i for i, m in mavlink.mavlink_map.items()} | {
    CommandCancel.msgname: COMMAND_CANCEL
}
"""MAVLink message name to its id."""


def frames(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Message id and bytes of each whole frame in a datagram; bytes that are none are skipped.

    A datagram holds whole frames (MAVLink over UDP), so that nothing is carried over to the next one. The checksum is
    left to `decode`.
    """
    at, end = 0, len(data)
    while at < end:
        magic = data[at]
        if magic == mavlink.PROTOCOL_MARKER_V2 and at + 12 <= end:
            length = 12 + data[at + 1]
            if data[at + 2] & mavlink.MAVLINK_IFLAG_SIGNED:
                length += mavlink.MAVLINK_SIGNATURE_BLOCK_LEN
            message_id = int.from_bytes(data[at + 7 : at + 10], "little")
        elif magic == mavlink.PROTOCOL_MARKER_V1 and at + 8 <= end:
            length = 8 + data[at + 1]
            message_id = data[at + 5]
        else:
            at += 1
            continue
        if at + length > end:
            at += 1
            continue
        yield message_id, data[at : at + length]
        at += length


def decode(parser: mavlink.MAVLink, frame: bytes) -> Any | None:
    """The message in a frame, or None when its checksum, signature or layout is wrong, or nobody knows it."""
    try:
        message = parser.decode(bytearray(frame))
    except (mavlink.MAVError, ValueError, UnicodeDecodeError, OverflowError, IndexError):
        return None
    return None if message.get_type().startswith("UNKNOWN_") else message
