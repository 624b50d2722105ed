"""Broken MAVLink: frames of every message, damaged in the ways that radios, bugs and strangers damage them. Seeded."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

_HEADER = 10
_WILD = (
    struct.pack("<f", float("nan")),
    struct.pack("<f", float("inf")),
    struct.pack("<f", -float("inf")),
    struct.pack("<f", 3.4e38),
    b"\xff\xff\xff\xff",
    b"\x00\x00\x00\x80",
    b"\xff\xff\xff\x7f",
    bytes(4),
)
_MOST = 280


def dialect_frames(
    rng: np.random.Generator, system: int = 1, component: int = 1, target: tuple[int, int] | None = None
) -> list[bytes]:
    """One valid MAVLink 2 frame of every message of the dialect, with random contents.

    Args:
        rng: of the contents.
        system: source system id.
        component: source component id.
        target: system and component to which messages that name one are addressed; None leaves that to chance.
    """
    found = []
    for message_id, kind in mavlink.mavlink_map.items():
        payload = bytearray(rng.bytes(_length(kind)))
        if target is not None:
            for name, number in zip(("target_system", "target_component"), target, strict=True):
                if name in kind.ordered_fieldnames:
                    payload[_offset(kind, name)] = number
        found.append(_frame(message_id, bytes(payload), system, component, int(rng.integers(256))))
    return found


class FrameMutator:
    """Draws damaged frames without end.

    About half of them carry a right checksum, so that they get past the framing and their contents are what is wrong.

    Args:
        frames: whole MAVLink frames to start from.
        rng: decides everything.
    """

    def __init__(self, frames: Sequence[bytes], rng: np.random.Generator) -> None:
        self._frames = list(frames)
        self._rng = rng
        self._ids = list(mavlink.mavlink_map)
        self._ways: tuple[Callable[[bytearray], bytes], ...] = (
            self._flip_bits,
            self._cut_short,
            self._lengthen,
            self._lie_about_the_length,
            self._join,
            self._set_flags,
            self._damage_contents,
            self._damage_contents,
            self._put_wild_numbers,
            self._put_wild_numbers,
            self._change_the_id,
            self._change_the_sender,
        )

    def mutated(self) -> bytes:
        """One damaged frame, or a piece, or some glued together; never longer than a datagram may be."""
        way = self._ways[self._below(len(self._ways))]
        return way(bytearray(self._pick()))

    def noise(self) -> bytes:
        """Random bytes, every third time behind a frame's start marker."""
        data = self._rng.bytes(1 + self._below(_MOST))
        return (b"\xfd", b"\xfe", b"")[self._below(3)] + data

    def _below(self, n: int) -> int:
        return int(self._rng.integers(n))

    def _pick(self) -> bytes:
        return self._frames[self._below(len(self._frames))]

    def _flip_bits(self, frame: bytearray) -> bytes:
        for _ in range(1 + self._below(6)):
            frame[self._below(len(frame))] ^= 1 << self._below(8)
        return bytes(frame)

    def _cut_short(self, frame: bytearray) -> bytes:
        return bytes(frame[: 1 + self._below(len(frame))])

    def _lengthen(self, frame: bytearray) -> bytes:
        return self._rng.bytes(self._below(8)) + bytes(frame) + self._rng.bytes(self._below(20))

    def _lie_about_the_length(self, frame: bytearray) -> bytes:
        frame[1] = self._below(256)
        return bytes(frame)

    def _join(self, frame: bytearray) -> bytes:
        other = self._pick()
        return bytes(frame[: 1 + self._below(len(frame))]) + other + bytes(frame)

    def _set_flags(self, frame: bytearray) -> bytes:
        """Incompatibility and compatibility flags: a signature that is not there, flags that nobody knows."""
        frame[2 + self._below(2)] = self._below(256)
        return _sealed(frame)

    def _damage_contents(self, frame: bytearray) -> bytes:
        if len(frame) > _HEADER + 2:
            for _ in range(1 + self._below(8)):
                frame[_HEADER + self._below(len(frame) - _HEADER - 2)] = self._below(256)
        return _sealed(frame)

    def _put_wild_numbers(self, frame: bytearray) -> bytes:
        words = (len(frame) - _HEADER - 2) // 4
        for _ in range(1 + self._below(4)):
            if words > 0:
                at = _HEADER + 4 * self._below(words)
                frame[at : at + 4] = _WILD[self._below(len(_WILD))]
        return _sealed(frame)

    def _change_the_id(self, frame: bytearray) -> bytes:
        number = self._ids[self._below(len(self._ids))] if self._below(4) else self._below(1 << 24)
        frame[7:10] = number.to_bytes(3, "little")
        return _sealed(frame)

    def _change_the_sender(self, frame: bytearray) -> bytes:
        frame[5], frame[6] = self._below(256), self._below(256)
        return _sealed(frame)


def _length(kind: Any) -> int:
    return int(struct.calcsize(kind.unpacker.format))


def _offset(kind: Any, name: str) -> int:
    """Of a one-byte field in the payload."""
    before = 0
    for field, code, count in zip(
        kind.ordered_fieldnames, kind.native_format.decode().lstrip("<>"), kind.array_lengths, strict=True
    ):
        if field == name:
            return before
        before += struct.calcsize(f"<{max(1, count)}{code}")
    raise ValueError(f"{kind.msgname} has no field {name}")


def _frame(message_id: int, payload: bytes, system: int, component: int, sequence: int) -> bytes:
    head = struct.pack("<BBBBBBB", mavlink.PROTOCOL_MARKER_V2, len(payload), 0, 0, sequence, system, component)
    return _sealed(bytearray(head + message_id.to_bytes(3, "little") + payload + b"\0\0"))


def _sealed(frame: bytearray) -> bytes:
    """With the checksum that belongs to the contents (X.25, with the message's CRC_EXTRA)."""
    if len(frame) < _HEADER + 2 or frame[0] != mavlink.PROTOCOL_MARKER_V2:
        return bytes(frame)
    kind = mavlink.mavlink_map.get(int.from_bytes(frame[7:10], "little"))
    crc = mavlink.x25crc(frame[1:-2])
    if kind is not None:
        crc.accumulate(struct.pack("B", kind.crc_extra))
    frame[-2:] = struct.pack("<H", crc.crc)
    return bytes(frame)
