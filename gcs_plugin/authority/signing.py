"""MAVLink 2 message signing: the key file, the check of what comes, the timestamp of what goes.

https://mavlink.io/en/guide/message_signing.html. pymavlink's own check is not used: it takes over the timestamp of a
frame before it has compared the signature, so that one forged frame silences the true sender, and it remembers every
sender that forged frames name.
"""

from __future__ import annotations

import hashlib
import hmac
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority.signature_memory import SignatureMemory, Stream
from mission.errors import SettingsError

KEY_BYTES: Final = 32
UNITS_PER_S: Final = 100_000
"""Timestamps count 10 us."""
EPOCH: Final = datetime(2015, 1, 1, tzinfo=UTC)
NEW_STREAM_UNITS: Final = 60 * UNITS_PER_S
"""How old the first frame of a stream may be."""
ORDER_AGE_UNITS: Final = 10 * UNITS_PER_S
"""How much later than the most punctual frame of its stream a frame may come."""
LAST_TIMESTAMP: Final = 2**48 - 2
MOST_STREAMS: Final = 256

Fault = Literal["unsigned", "forged", "replayed", "old"]


def read_key(path: Path) -> bytes:
    """The key of a file: 32 bytes, or 64 hexadecimal digits, or a passphrase whose SHA-256 it is (as in MAVProxy).

    Raises:
        SettingsError: the file cannot be read or holds nothing.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise SettingsError(
            f"cannot read the signing key {path}: {error.strerror}", "Give the path of a key file."
        ) from error
    if len(content) == KEY_BYTES:
        return content
    line = content.strip()
    if not line:
        raise SettingsError(f"the signing key {path} is empty", "Put 64 hexadecimal digits or a passphrase into it.")
    try:
        key = bytes.fromhex(line.decode("ascii"))
    except ValueError:
        key = b""
    return key if len(key) == KEY_BYTES else hashlib.sha256(line).digest()


def timestamp_of(utc: datetime) -> int:
    """A time as a signature's timestamp."""
    return int((utc - EPOCH).total_seconds() * UNITS_PER_S)


class SignatureCheck:
    """Whether frames are signed with the key, later than what their sender signed before, and not held back.

    A station's clock may be off, and some count their frames rather than the time, so that the age of a frame says
    little by itself. But all stations take over the time of the signed frames that they hear (the component's
    heartbeat, once a second), so that the frames of one sender lag about the same behind this program's monotonic
    clock: one that lags by `ORDER_AGE_UNITS` more than the most punctual one of its stream was held back on its way.
    Steps of this computer's clock (a GPS fix, NTP) do not count. The first frame of a stream is measured by UTC.

    `fresh` and `timestamp` may be called from any thread, `first_seen` from one, the rest from one other.

    Args:
        key: 32 bytes.
        utc: the present time.
        memory: of the timestamps before the program's start; without it a restart forgets them.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        key: bytes,
        utc: Callable[[], datetime],
        memory: SignatureMemory | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._key = key
        self._utc = utc
        self._clock = clock
        self._memory = memory
        self._streams = {} if memory is None else dict(memory.streams)
        self._lags: dict[Stream, int] = {}
        """By how much each stream's most punctual frame was behind the monotonic clock, since the program's start."""
        self._floor = timestamp_of(utc()) if memory is not None and memory.lost else 0
        """What a stream of which nothing is known has signed until then may be a replay."""
        self._seen: dict[Stream, int] = {}
        self._lock = threading.Lock()
        self._reference = (max(self._streams.values(), default=0), clock())
        """The latest timestamp that was signed by anybody or given out, and when."""
        self.behind_s = 0.0
        """By how much the last frame that was "old" came too late."""

    def fresh(self, frame: bytes) -> bool:
        """Whether a frame is signed with the key, later than what its stream signed before; it is not used up."""
        if self._wrong(frame) is not None:
            return False
        stamp, stream = _stamp(frame)
        known = self._streams.get(stream)
        return known is None or stamp > known

    def first_seen(self, frame: bytes) -> bool:
        """Whether a frame is fresh, and later than all of its stream for which this was answered.

        For the thread that reads the link, so that frames played again do not pile up before those that wait.
        """
        if not self.fresh(frame):
            return False
        stamp, stream = _stamp(frame)
        seen = self._seen.get(stream)
        if (len(self._seen) >= MOST_STREAMS) if seen is None else (stamp <= seen):
            return False
        self._seen[stream] = stamp
        return True

    def fault(self, frame: bytes, *, order: bool = True, ageless: bool = False) -> Fault | None:
        """What is wrong with a frame's signature; None when it is good, and the frame is used up then.

        Args:
            frame: a whole frame whose checksum is right.
            order: whether it will be obeyed when nothing is wrong, so that it must not come again, whatever happens.
            ageless: whether it may come late: a stop does no harm.
        """
        wrong = self._wrong(frame)
        if wrong is not None:
            return wrong
        stamp, stream = _stamp(frame)
        known = self._streams.get(stream)
        if known is not None and stamp <= known:
            return "replayed"
        if known is None and len(self._streams) >= MOST_STREAMS:
            return "old"
        if not ageless and self._late(stamp, stream):
            return "old"
        self._streams[stream] = stamp
        with self._lock:
            self._reference = (max(stamp, self._going_on()), self._clock())
        if self._memory is not None:
            self._memory.keep(self._streams, self._utc().timestamp(), order=order)
        return None

    def timestamp(self) -> int:
        """For the next frame that we sign: the present time, or what the newest good frame made of it if that is later.

        It goes on with the time, and never back.
        """
        with self._lock:
            present = max(timestamp_of(self._utc()), self._going_on())
            self._reference = (present, self._clock())
            return min(present, LAST_TIMESTAMP)

    def _going_on(self) -> int:
        """The latest timestamp, as it has grown with the time since."""
        stamp, at_s = self._reference
        return stamp + int((self._clock() - at_s) * UNITS_PER_S)

    def _wrong(self, frame: bytes) -> Fault | None:
        signed = (
            len(frame) > 12 + mavlink.MAVLINK_SIGNATURE_BLOCK_LEN
            and frame[0] == mavlink.PROTOCOL_MARKER_V2
            and frame[2] & mavlink.MAVLINK_IFLAG_SIGNED
        )
        if not signed:
            return "unsigned"
        expected = hashlib.sha256(self._key + frame[:-6]).digest()[:6]
        return None if hmac.compare_digest(expected, bytes(frame[-6:])) else "forged"

    def _late(self, stamp: int, stream: Stream) -> bool:
        """Whether a frame was held back; the most punctual one of its stream is noted."""
        lag = int(self._clock() * UNITS_PER_S) - stamp
        usual = self._lags.get(stream)
        if usual is None:
            too_late = self.timestamp() - stamp - NEW_STREAM_UNITS
            if stream not in self._streams:
                too_late = max(too_late, self._floor - stamp)
            behind = self.timestamp() - stamp
        else:
            too_late = lag - usual - ORDER_AGE_UNITS
            behind = lag - usual
        if too_late > 0:
            self.behind_s = behind / UNITS_PER_S
            return True
        self._lags[stream] = lag if usual is None else min(lag, usual)
        return False


def _stamp(frame: bytes) -> tuple[int, Stream]:
    """Timestamp and stream of a signed frame."""
    return int.from_bytes(frame[-12:-6], "little"), (frame[-13], frame[5], frame[6])
