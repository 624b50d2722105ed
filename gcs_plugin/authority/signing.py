"""MAVLink 2 message signing: the key file, the check of what comes, the timestamp of what goes.

https://mavlink.io/en/guide/message_signing.html. pymavlink's own check is not used: it takes over the timestamp of a
frame before it has compared the signature, so that one forged frame silences the true sender, and it remembers every
sender that forged frames name.
"""

from __future__ import annotations

import hashlib
import hmac
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
"""How old the first frame of a sender may be."""
ORDER_AGE_UNITS: Final = 10 * UNITS_PER_S
"""How much later than its sender's other frames a frame may come."""
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

    A station's clock may be off, and some count on from their start, so that the age of a frame says little by itself.
    But the frames of one sender all lag the same behind the present time: one that lags by 10 s more than the last good
    one was held back on its way, and is no order any more.

    Args:
        key: 32 bytes.
        utc: the present time.
        memory: of the timestamps before the program's start; without it a restart forgets them.
    """

    def __init__(self, key: bytes, utc: Callable[[], datetime], memory: SignatureMemory | None = None) -> None:
        self._key = key
        self._utc = utc
        self._memory = memory
        self._streams = {} if memory is None else dict(memory.streams)
        self._lags: dict[Stream, int] = {}
        """By how much each sender's last good frame was behind the present time, since the start of the program."""
        self._newest = max(self._streams.values(), default=0)

    def genuine(self, frame: bytes) -> bool:
        """Whether a frame carries the key's signature, however old it is; the frame is not used up."""
        return self._wrong(frame) is None

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

    def fault(self, frame: bytes, *, order: bool = True) -> Fault | None:
        """What is wrong with a frame's signature; None when it is good, and the frame is used up then.

        Args:
            frame: a whole frame whose checksum is right.
            order: whether it will be obeyed when nothing is wrong, so that it must not come again, whatever happens.
        """
        wrong = self._wrong(frame)
        if wrong is not None:
            return wrong
        stamp = int.from_bytes(frame[-12:-6], "little")
        stream = (frame[-13], frame[5], frame[6])
        known = self._streams.get(stream)
        if known is not None and stamp <= known:
            return "replayed"
        if known is None and (stamp + NEW_STREAM_UNITS < self.timestamp() or len(self._streams) >= MOST_STREAMS):
            return "old"
        self._streams[stream] = stamp
        lag, usual = timestamp_of(self._utc()) - stamp, self._lags.get(stream)
        if lag > (NEW_STREAM_UNITS if usual is None else usual + ORDER_AGE_UNITS):
            return "old"
        self._lags[stream] = lag
        self._newest = max(self._newest, stamp)
        if self._memory is not None:
            self._memory.keep(self._streams, self._utc().timestamp(), order=order)
        return None

    def timestamp(self) -> int:
        """For the next frame that we sign: the present time, or the newest good one that came if that is later."""
        return max(timestamp_of(self._utc()), self._newest)
