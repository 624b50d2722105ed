"""AT commands: what a client tells the AR.Drone over UDP 5556 (AR.Drone SDK 2.0, Developer Guide, chapter 6).

A command is one line of ASCII, ``AT*NAME=SEQUENCE,ARGUMENT,...<CR>``. The drone ignores a sequence number that is not
larger than the last one it took; 1 starts anew. Several commands may share a datagram of at most 1024 bytes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

MAX_DATAGRAM = 1024
_REF_ALWAYS = 1 << 18 | 1 << 20 | 1 << 22 | 1 << 24 | 1 << 28
_REF_FLY = 1 << 9
_REF_EMERGENCY = 1 << 8
_PCMD_PROGRESSIVE = 1


class CtrlMode(IntEnum):
    """First argument of AT*CTRL that a client has use for."""

    GET_CONFIGURATION = 4
    """Send the configuration over TCP 5559."""
    ACKNOWLEDGE = 5
    """Clear the command acknowledgement in navdata's state."""


@dataclass(frozen=True, slots=True)
class AtCommand:
    """One AT command without its sequence number."""

    name: str
    arguments: tuple[str, ...] = ()

    def encode(self, sequence: int) -> bytes:
        """The line as it is sent.

        Raises:
            ValueError: the sequence number is below 1.
        """
        if sequence < 1:
            raise ValueError(f"sequence numbers begin at 1, not {sequence}")
        return f"AT*{self.name}={','.join((str(sequence), *self.arguments))}\r".encode("ascii")


@dataclass(frozen=True, slots=True)
class Tilt:
    """Progressive motion, each a share of the configured maximum, -1 to 1."""

    roll: float = 0.0
    """Positive tilts and flies to the right (control:euler_angle_max)."""
    pitch: float = 0.0
    """Positive raises the nose and flies backwards (control:euler_angle_max)."""
    gaz: float = 0.0
    """Positive climbs (control:control_vz_max)."""
    yaw: float = 0.0
    """Positive turns clockwise (control:control_yaw)."""


def float_as_int(value: float) -> int:
    """The 32 bits of a float read as a signed integer: how AT commands spell -1 to 1 (-0.8 is -1085485875).

    Raises:
        ValueError: not a number from -1 to 1.
    """
    if not -1.0 <= value <= 1.0:
        raise ValueError(f"a share of a maximum is a number from -1 to 1, not {value}")
    (bits,) = struct.unpack("<i", struct.pack("<f", value))
    return int(bits)


def ref(*, fly: bool, emergency: bool = False) -> AtCommand:
    """AT*REF: take off or stay up (`fly`), or land and stay down; the emergency bit cuts the motors, or resets that."""
    bits = _REF_ALWAYS | (_REF_FLY if fly else 0) | (_REF_EMERGENCY if emergency else 0)
    return AtCommand("REF", (str(bits),))


def pcmd(tilt: Tilt | None) -> AtCommand:
    """AT*PCMD: fly by tilt, or with None hover on the drone's own (flag 0)."""
    if tilt is None:
        return AtCommand("PCMD", ("0", "0", "0", "0", "0"))
    return AtCommand("PCMD", (str(_PCMD_PROGRESSIVE), *_shares(tilt)))


def ftrim() -> AtCommand:
    """AT*FTRIM: the drone stands on level ground; only sent on the ground."""
    return AtCommand("FTRIM")


def comwdg() -> AtCommand:
    """AT*COMWDG: take the communication watchdog back."""
    return AtCommand("COMWDG")


def config(key: str, value: str) -> AtCommand:
    """AT*CONFIG: set ``category:name``.

    Raises:
        ValueError: a quote or a control character in either.
    """
    return AtCommand("CONFIG", (_quoted(key), _quoted(value)))


def config_ids(session: str, profile: str, application: str) -> AtCommand:
    """AT*CONFIG_IDS: whose configuration the next AT*CONFIG sets; it goes right before it.

    Raises:
        ValueError: a quote or a control character in one of them.
    """
    return AtCommand("CONFIG_IDS", (_quoted(session), _quoted(profile), _quoted(application)))


def ctrl(mode: CtrlMode) -> AtCommand:
    """AT*CTRL."""
    return AtCommand("CTRL", (str(int(mode)), "0"))


class Sequencer:
    """Numbers the commands of one client, from 1."""

    def __init__(self) -> None:
        self.last = 0

    def datagrams(self, commands: Iterable[AtCommand]) -> list[bytes]:
        """The commands in order, in as few datagrams as hold them.

        Raises:
            ValueError: a command is longer than a datagram.
        """
        packed: list[bytes] = []
        for command in commands:
            self.last += 1
            line = command.encode(self.last)
            if len(line) > MAX_DATAGRAM:
                raise ValueError(f"AT*{command.name} has {len(line)} bytes, more than {MAX_DATAGRAM}")
            if packed and len(packed[-1]) + len(line) <= MAX_DATAGRAM:
                packed[-1] += line
            else:
                packed.append(line)
        return packed


def clamped(share: float) -> float:
    """A share of a maximum, limited to -1 to 1; what is not a number becomes 0 (no motion)."""
    return max(-1.0, min(1.0, share)) if math.isfinite(share) else 0.0


def _shares(tilt: Tilt) -> tuple[str, str, str, str]:
    roll, pitch, gaz, yaw = (str(float_as_int(share)) for share in (tilt.roll, tilt.pitch, tilt.gaz, tilt.yaw))
    return roll, pitch, gaz, yaw


def _quoted(text: str) -> str:
    if not text.isascii() or not text.isprintable() or '"' in text:
        raise ValueError(f"{text!r} cannot stand in an AT command")
    return f'"{text}"'
