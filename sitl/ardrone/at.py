"""AT commands: the text that pilots an AR.Drone, as its firmware reads it (UDP 5556).

A datagram holds one or more commands ``AT*NAME=SEQUENCE[,ARGUMENT...]``, each ended by a carriage return. Numbers are
decimal; a float is sent as the signed integer with the same 32 bits (IEEE 754); strings stand in double quotes.
Source: AR.Drone Developer Guide, SDK 2.0, chapter 6. What cannot be read is left out, as the guide says it is ignored.
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass

LONGEST_COMMAND = 1024
"""Characters; a longer line is rejected as a whole (section 6.1)."""

TAKE_OFF_BIT = 1 << 9
EMERGENCY_BIT = 1 << 8
PROGRESSIVE_BIT = 1 << 0
ABSOLUTE_BIT = 1 << 2

CONFIGURATION_GET = 4
ACKNOWLEDGE = 5
CUSTOM_CONFIGURATION_GET = 6

_LINE = re.compile(r"AT\*([A-Z][A-Z_0-9]*)=(\d{1,10})(?:,(.*))?", re.ASCII | re.DOTALL)
_ARGUMENT = re.compile(r'"((?:[^"\\]|\\.)*)"|(-?\d{1,11})', re.ASCII)


@dataclass(frozen=True, slots=True)
class Ref:
    """Take-off or land (bit 9), emergency (bit 8)."""

    sequence: int
    bits: int

    @property
    def take_off(self) -> bool:
        """Bit 9: 1 asks for the air, 0 for the ground."""
        return bool(self.bits & TAKE_OFF_BIT)

    @property
    def emergency(self) -> bool:
        """Bit 8; its change from 0 to 1 toggles the emergency."""
        return bool(self.bits & EMERGENCY_BIT)


@dataclass(frozen=True, slots=True)
class Pcmd:
    """Movement, in fractions of the configured limits (-1 to 1).

    `psi` is only there in PCMD_MAG: the pilot's own magnetic heading, -1 to 1 for -180 to 180 degrees.
    """

    sequence: int
    flags: int
    roll: float
    """Positive tilts to the right."""
    pitch: float
    """Positive raises the nose: flies backwards."""
    gaz: float
    """Positive climbs."""
    yaw: float
    """Positive turns clockwise."""
    psi: float | None = None

    @property
    def progressive(self) -> bool:
        """Without this bit the aircraft hovers, whatever the rest says."""
        return bool(self.flags & PROGRESSIVE_BIT)

    @property
    def absolute(self) -> bool:
        """Roll and pitch are meant along the pilot's own heading."""
        return bool(self.flags & ABSOLUTE_BIT) and self.psi is not None


@dataclass(frozen=True, slots=True)
class Ftrim:
    """The aircraft stands level: take the present attitude as horizontal."""

    sequence: int


@dataclass(frozen=True, slots=True)
class Config:
    """Set a value of the configuration."""

    sequence: int
    key: str
    value: str


@dataclass(frozen=True, slots=True)
class ConfigIds:
    """For whom the next `Config` is meant."""

    sequence: int
    session: str
    user: str
    application: str


@dataclass(frozen=True, slots=True)
class Comwdg:
    """Reset the communication watchdog."""

    sequence: int


@dataclass(frozen=True, slots=True)
class Calib:
    """Calibrate a device; 0 is the magnetometer, in flight."""

    sequence: int
    device: int


@dataclass(frozen=True, slots=True)
class Ctrl:
    """Control channel: 4 asks for the configuration, 5 acknowledges, 6 asks for the custom identifiers."""

    sequence: int
    mode: int


@dataclass(frozen=True, slots=True)
class Other:
    """A well-formed command that this aircraft does not act on (LED, ANIM, ...)."""

    sequence: int
    name: str


Command = Ref | Pcmd | Ftrim | Config | ConfigIds | Comwdg | Calib | Ctrl | Other
_Argument = int | str


def parse_datagram(data: bytes) -> list[Command]:
    """The commands of a datagram in their order; what is malformed is left out. Never raises."""
    found: list[Command] = []
    for line in re.split(rb"[\r\n]", data):
        command = _parse_line(line)
        if command is not None:
            found.append(command)
    return found


def float_of(bits: int) -> float:
    """The float whose 32 bits are this signed (or unsigned) integer."""
    value: float = struct.unpack("<f", struct.pack("<I", bits & 0xFFFFFFFF))[0]
    return value


def _parse_line(line: bytes) -> Command | None:
    if not line or len(line) > LONGEST_COMMAND:
        return None
    found = _LINE.fullmatch(line.rstrip(b"\0").decode("latin-1"))
    if found is None:
        return None
    arguments = _arguments(found[3] or "")
    return None if arguments is None else _typed(found[1], int(found[2]), arguments)


def _arguments(text: str) -> list[_Argument] | None:
    """Numbers and strings between commas; None where there is anything else. A comma at the end is forgiven."""
    arguments: list[_Argument] = []
    at = 0
    while at < len(text):
        found = _ARGUMENT.match(text, at)
        if found is None:
            return None
        arguments.append(re.sub(r"\\(.)", r"\1", found[1]) if found[1] is not None else int(found[2]))
        at = found.end()
        if at < len(text) and text[at] != ",":
            return None
        at += 1
    return arguments


def _typed(name: str, sequence: int, arguments: list[_Argument]) -> Command | None:
    """The command of a name; None when its arguments are not what it takes."""
    match name, arguments:
        case "REF", [int(bits)]:
            return Ref(sequence, bits & 0xFFFFFFFF)
        case "PCMD", [int(flags), int(), int(), int(), int()]:
            return _movement(sequence, flags, arguments[1:])
        case "PCMD_MAG", [int(flags), int(), int(), int(), int(), int(), int()]:
            return _movement(sequence, flags, arguments[1:6])
        case "FTRIM", []:
            return Ftrim(sequence)
        case "CONFIG", [str(key), str(value)]:
            return Config(sequence, key, value)
        case "CONFIG_IDS", [str(session), str(user), str(application)]:
            return ConfigIds(sequence, session, user, application)
        case "COMWDG", []:
            return Comwdg(sequence)
        case "CALIB", [int(device)]:
            return Calib(sequence, device)
        case "CTRL", [int(mode)] | [int(mode), int()]:
            return Ctrl(sequence, mode)
        case (("REF" | "PCMD" | "PCMD_MAG" | "FTRIM" | "CONFIG" | "CONFIG_IDS" | "COMWDG" | "CALIB" | "CTRL"), _):
            return None
    return Other(sequence, name)


def _movement(sequence: int, flags: int, bits: list[_Argument]) -> Pcmd | None:
    values = [float_of(int(word)) for word in bits]
    if not all(math.isfinite(value) for value in values):
        return None
    roll, pitch, gaz, yaw, *psi = (max(-1.0, min(1.0, value)) for value in values)
    return Pcmd(sequence, flags, roll, pitch, gaz, yaw, psi[0] if psi else None)
