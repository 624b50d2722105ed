"""The parameter protocol: PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET in; PARAM_VALUE out.

https://mavlink.io/en/services/parameter.html. Integers travel in a float field in one of two ways, as the autopilot of
the same vehicle does it, since stations take the whole vehicle for one: ArduPilot casts them, PX4 copies their bytes.
A value that the settings refuse is answered with the old one.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component.identity import ParameterEncoding
from gcs_plugin.component.parameter_table import Parameter, parameters, wider_than
from mission.settings import MissionSettings

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

PARAMETER_MESSAGES: Final = ("PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET")
LIST_RATE_HZ: Final = 50.0
"""Slow enough for a telemetry radio."""

_FORMATS: Final[dict[int, str]] = {
    mavlink.MAV_PARAM_TYPE_UINT8: "<Bxxx",
    mavlink.MAV_PARAM_TYPE_INT8: "<bxxx",
    mavlink.MAV_PARAM_TYPE_UINT16: "<Hxx",
    mavlink.MAV_PARAM_TYPE_INT16: "<hxx",
    mavlink.MAV_PARAM_TYPE_UINT32: "<I",
    mavlink.MAV_PARAM_TYPE_INT32: "<i",
}


def encoded(number: float, kind: int, encoding: ParameterEncoding) -> float:
    """A parameter's number as PARAM_VALUE's float.

    Args:
        number: of the setting.
        kind: MAV_PARAM_TYPE.
        encoding: of integers.
    """
    if encoding == "c-cast" or kind not in _FORMATS:
        return number
    (value,) = struct.unpack("<f", struct.pack(_FORMATS[kind], int(number)))
    return float(value)


def decoded(value: float, kind: int, encoding: ParameterEncoding) -> float | None:
    """The number in PARAM_SET's float; None for a type that is not understood."""
    if kind == mavlink.MAV_PARAM_TYPE_REAL32 or (encoding == "c-cast" and kind in _FORMATS):
        return value
    if kind not in _FORMATS:
        return None
    (number,) = struct.unpack(_FORMATS[kind], struct.pack("<f", value))
    return float(number)


class ParameterServer:
    """Answers for the settings, and changes them.

    Args:
        settings: at the start.
        encoding: of integers.
        file: the settings file's own, whose safety limits nobody widens; those at the start when omitted.
        say: is told why a change is not taken.
    """

    def __init__(
        self,
        settings: MissionSettings,
        encoding: ParameterEncoding,
        file: MissionSettings | None = None,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.settings = settings
        """As they are now; a flight takes them when it starts."""
        self._file = file or settings
        self._say = say
        self._encoding = encoding
        self._all = parameters()
        self._index = {p.name: i for i, p in enumerate(self._all)}
        self._to_send: deque[int] = deque()
        self._next_s = 0.0

    def take(self, message: Message, *, may_change: bool) -> list[Message]:
        """Answer a message of `PARAMETER_MESSAGES`.

        Args:
            message: for this component.
            may_change: whether its sender may change settings.
        """
        match message.get_type():
            case "PARAM_REQUEST_LIST":
                # Asked again in the middle of the list: start again, rather than send it twice.
                self._to_send = deque(range(len(self._all)))
                return []
            case "PARAM_REQUEST_READ":
                index = message.param_index if message.param_index >= 0 else self._index.get(_name(message), -1)
                return [self._value(index)] if 0 <= index < len(self._all) else []
            case "PARAM_SET":
                return self._set(message, may_change)
        return []

    def due(self, now_s: float) -> list[Message]:
        """The next of the list that was asked for."""
        if not self._to_send:
            return []
        self._next_s = max(self._next_s, now_s - 0.1)
        messages = []
        while self._to_send and self._next_s <= now_s:
            messages.append(self._value(self._to_send.popleft()))
            self._next_s += 1.0 / LIST_RATE_HZ
        return messages

    def _set(self, message: Message, may_change: bool) -> list[Message]:
        index = self._index.get(_name(message))
        if index is None:
            return []
        parameter = self._all[index]
        number = decoded(message.param_value, message.param_type, self._encoding)
        if may_change and number is not None and self._fits(parameter, message.param_type):
            changed = parameter.changed(self.settings, number)
            refused = None if changed is None else wider_than(parameter, changed, self._file)
            if refused is not None:
                self._say(refused)
            elif changed is not None:
                self.settings = changed
        return [self._value(index)]

    def _fits(self, parameter: Parameter, kind: int) -> bool:
        """Whether a number of this type may be meant for the parameter.

        Where integers are cast, any type may: ArduPilot ignores it, and some stations send REAL32 for everything. Where
        their bytes are copied, a float is meant for a float, and a whole number, of any size, for a whole number.
        """
        if self._encoding == "c-cast":
            return True
        return bool((parameter.type == mavlink.MAV_PARAM_TYPE_REAL32) == (kind == mavlink.MAV_PARAM_TYPE_REAL32))

    def _value(self, index: int) -> Message:
        p = self._all[index]
        return mavlink.MAVLink_param_value_message(
            p.name.encode("ascii"),
            encoded(p.read(self.settings), p.type, self._encoding),
            p.type,
            len(self._all),
            index,
        )


def _name(message: Message) -> str:
    name = message.param_id
    return name if isinstance(name, str) else bytes(name).rstrip(b"\0").decode("ascii", "replace")
