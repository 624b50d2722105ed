"""The truth of a simulated flight, shared between the simulator's own processes and with nobody else.

The autopilot's process writes where the aircraft really is into a ring in shared memory; the camera's process reads it
to render, and the scorer reads it afterwards. Nothing of `mission` or `gcs_plugin` ever sees it.
"""

from __future__ import annotations

import math
import struct
import sys
import threading
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory

import numpy as np

from mission.records import Vector

MARKS = 8
"""Number of named instants a ring can hold; mark 0 is when the people started walking."""

_MAGIC = 0x5349_4445_5452_5554
_HEADER = struct.Struct("<QQQQ")  # magic, capacity, reserved, records written so far
_COUNT_WORD = 3
_MARKS_OFFSET = _HEADER.size
_RECORDS_OFFSET = _MARKS_OFFSET + 8 * MARKS
_PAYLOAD = struct.Struct("<Q15d")  # number of the record, time, position, velocity, attitude, gimbal or NaN
_RECORD = struct.Struct("<Q15dI4x")  # the payload and its CRC-32
_RETRIES = 50
_NO_GIMBAL = (math.nan,) * 4


@dataclass(frozen=True, slots=True, eq=False)
class VehicleTruth:
    """The aircraft's true state at `t_s` (monotonic clock). Local ENU around the scenario's home."""

    t_s: float
    position_enu_m: Vector
    """(3,)"""
    velocity_enu_m_s: Vector
    """(3,)"""
    world_from_body_wxyz: Vector
    """(4,), body forward-right-down."""
    world_from_gimbal_wxyz: Vector | None = None
    """(4,), where the camera is on a gimbal."""


class TruthRing:
    """The newest seconds of truth in shared memory: one process writes, any number read.

    A reader never sees half a record: every record carries its number and a CRC-32 over both, so a record that is
    overwritten while it is read is recognised, whatever order the processor makes the stores visible in.
    """

    def __init__(self, memory: SharedMemory, capacity: int) -> None:
        self._memory = memory
        self._capacity = capacity
        self._buffer = _buffer_of(memory)
        self._words = self._buffer[: _HEADER.size].cast("Q")
        self._marks = self._buffer[_MARKS_OFFSET:_RECORDS_OFFSET].cast("d")
        self._closed = False

    @classmethod
    def create(cls, *, seconds: float = 300.0, rate_hz: float = 200.0) -> TruthRing:
        """Make a ring that holds `seconds` of records written at `rate_hz`.

        Raises:
            ValueError: the product is not a positive number of records.
        """
        capacity = math.ceil(seconds * rate_hz)
        if capacity < 2:
            raise ValueError(f"a ring of {capacity} records cannot interpolate; ask for more seconds or a higher rate")
        memory = SharedMemory(create=True, size=_RECORDS_OFFSET + capacity * _RECORD.size)
        _HEADER.pack_into(_buffer_of(memory), 0, _MAGIC, capacity, 0, 0)
        ring = cls(memory, capacity)
        for i in range(MARKS):
            ring._marks[i] = math.nan
        return ring

    @classmethod
    def attach(cls, name: str) -> TruthRing:
        """Open the ring that another process created.

        Raises:
            FileNotFoundError: there is no such ring.
            ValueError: the shared memory of this name is not a truth ring.
        """
        memory = _attach_untracked(name)
        if memory.size < _RECORDS_OFFSET:
            memory.close()
            raise ValueError(f"shared memory {name} is too small for a truth ring")
        magic, capacity, _, _ = _HEADER.unpack_from(_buffer_of(memory), 0)
        if magic != _MAGIC or memory.size < _RECORDS_OFFSET + capacity * _RECORD.size:
            memory.close()
            raise ValueError(f"shared memory {name} is not a truth ring")
        return cls(memory, capacity)

    @property
    def name(self) -> str:
        """What another process gives to `attach`."""
        return self._memory.name

    def write(self, truth: VehicleTruth) -> None:
        """Append a record; times must increase. Only one process may write."""
        number = self._words[_COUNT_WORD]
        p, v, q = truth.position_enu_m, truth.velocity_enu_m_s, truth.world_from_body_wxyz
        g = _NO_GIMBAL if truth.world_from_gimbal_wxyz is None else truth.world_from_gimbal_wxyz
        payload = _PAYLOAD.pack(number, truth.t_s, *p, *v, *q, *g)
        record = payload + struct.pack("<I4x", zlib.crc32(payload))
        offset = self._offset(number)
        self._buffer[offset : offset + _RECORD.size] = record
        self._words[_COUNT_WORD] = number + 1

    def newest(self) -> VehicleTruth | None:
        """The last record written, None before the first."""
        for _ in range(_RETRIES):
            count = self._words[_COUNT_WORD]
            if count == 0:
                return None
            truth = self._read(count - 1)
            if truth is not None:
                return truth
        return None

    def at(self, t_s: float) -> VehicleTruth | None:
        """The truth at a time between two records (attitude on the sphere); None outside what the ring holds."""
        for _ in range(_RETRIES):
            count = self._words[_COUNT_WORD]
            if count == 0:
                return None
            low, high = max(0, count - self._capacity), count - 1
            before, after = self._bracket(t_s, low, high)
            if before is not None and after is not None:
                return _interpolate(before, after, t_s) if before.t_s <= t_s <= after.t_s else None
        return None

    def history(self) -> list[VehicleTruth]:
        """All that the ring still holds, oldest first."""
        return list(self._records())

    def set_mark(self, i: int, t_s: float) -> None:
        """Remember an instant that the simulator's processes share, in slot 0 to 7."""
        self._marks[_slot(i)] = t_s

    def mark(self, i: int) -> float | None:
        """The instant in slot i, None if it was never set."""
        t_s = self._marks[_slot(i)]
        return None if math.isnan(t_s) else t_s

    def close(self) -> None:
        """Let go of the memory in this process. Safe to call twice."""
        if not self._closed:
            self._closed = True
            self._words.release()
            self._marks.release()
            self._buffer.release()
            self._memory.close()

    def __del__(self) -> None:
        if hasattr(self, "_closed"):
            self.close()

    def unlink(self) -> None:
        """Free the memory for all; only the creator does this, once."""
        self._memory.unlink()

    def _offset(self, number: int) -> int:
        return _RECORDS_OFFSET + (number % self._capacity) * _RECORD.size

    def _read(self, number: int) -> VehicleTruth | None:
        offset = self._offset(number)
        raw = bytes(self._buffer[offset : offset + _RECORD.size])
        found, t_s, *state, crc = _RECORD.unpack(raw)
        if found != number or crc != zlib.crc32(raw[: _PAYLOAD.size]):
            return None
        values = np.array(state)
        gimbal = None if math.isnan(values[10]) else values[10:14]
        return VehicleTruth(t_s, values[0:3], values[3:6], values[6:10], gimbal)

    def _bracket(self, t_s: float, low: int, high: int) -> tuple[VehicleTruth | None, VehicleTruth | None]:
        """The neighbours of `t_s` by bisection; equal at the ends, None where the writer overtook us."""
        first, last = self._read(low), self._read(high)
        while high - low > 1:
            middle = (low + high) // 2
            truth = self._read(middle)
            if truth is None:  # overwritten meanwhile: only newer ones are left
                low, first = middle, None
            elif truth.t_s <= t_s:
                low, first = middle, truth
            else:
                high, last = middle, truth
        return first, last

    def _records(self) -> Iterator[VehicleTruth]:
        count = self._words[_COUNT_WORD]
        for number in range(max(0, count - self._capacity), count):
            truth = self._read(number)
            if truth is not None:
                yield truth


def _buffer_of(memory: SharedMemory) -> memoryview:
    buffer = memory.buf
    if buffer is None:
        raise ValueError("the shared memory is closed")
    return buffer.cast("B")


def _slot(i: int) -> int:
    if not 0 <= i < MARKS:
        raise IndexError(f"a truth ring has marks 0 to {MARKS - 1}, not {i}")
    return i


def _interpolate(a: VehicleTruth, b: VehicleTruth, t_s: float) -> VehicleTruth:
    """Cubic Hermite for the position, linear for the velocity, great circle for the attitude."""
    span = b.t_s - a.t_s
    if span <= 0.0:
        return a
    s = (t_s - a.t_s) / span
    position = (
        (1 + 2 * s) * (1 - s) ** 2 * a.position_enu_m
        + s * (1 - s) ** 2 * span * a.velocity_enu_m_s
        + s * s * (3 - 2 * s) * b.position_enu_m
        - s * s * (1 - s) * span * b.velocity_enu_m_s
    )
    velocity = (1 - s) * a.velocity_enu_m_s + s * b.velocity_enu_m_s
    gimbal = None
    if a.world_from_gimbal_wxyz is not None and b.world_from_gimbal_wxyz is not None:
        gimbal = _slerp(a.world_from_gimbal_wxyz, b.world_from_gimbal_wxyz, s)
    return VehicleTruth(t_s, position, velocity, _slerp(a.world_from_body_wxyz, b.world_from_body_wxyz, s), gimbal)


def _slerp(a: Vector, b: Vector, s: float) -> Vector:
    cosine = float(a @ b)
    if cosine < 0.0:
        b, cosine = -b, -cosine
    angle = math.acos(min(1.0, cosine))
    if angle < 1e-6:
        q = (1 - s) * a + s * b
    else:
        q = (math.sin((1 - s) * angle) * a + math.sin(s * angle) * b) / math.sin(angle)
    return np.asarray(q / np.linalg.norm(q))


_attaching = threading.Lock()


def _attach_untracked(name: str) -> SharedMemory:
    """Attach without telling the resource tracker, which before 3.13 would free the memory when this process ends."""
    if sys.version_info >= (3, 13):
        return SharedMemory(name, track=False)
    with _attaching:
        register = resource_tracker.register
        setattr(resource_tracker, "register", _register_nothing)  # noqa: B010 (a typed module function)
        try:
            return SharedMemory(name)
        finally:
            setattr(resource_tracker, "register", register)  # noqa: B010


def _register_nothing(name: str, rtype: str) -> None:
    """Stands in for `resource_tracker.register` while attaching."""
