"""The parameters of `sidestep serve`, read and set by name over MAVLink's parameter protocol."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component.identity import ParameterEncoding
from gcs_plugin.component.parameter_protocol import decoded, encoded
from mission.errors import SettingsError

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

ANSWER_S: Final = 0.7
SENDINGS: Final = 5
_NAME: Final = re.compile(r"[A-Z][A-Z0-9_]{0,15}$")


@dataclass(frozen=True, slots=True)
class Peer:
    """Whose parameters, and how it writes integers."""

    system: int
    component: int
    encoding: ParameterEncoding


@dataclass(slots=True)
class _Talk:
    wanted: float | None
    deadline_s: float
    sendings: int = 0
    kind: int | None = None
    """MAV_PARAM_TYPE, once it is known."""


class ParameterTalk:
    """Reads a parameter, and sets it when a value is wanted; the answer is what the component says it is then.

    Args:
        send: a message.
        tell: the operator.
        peer: whose parameters, now.
    """

    def __init__(self, send: Callable[[Message], None], tell: Callable[[str], None], peer: Callable[[], Peer]) -> None:
        self._send = send
        self._tell = tell
        self._peer = peer
        self._talks: dict[str, _Talk] = {}

    def begin(self, name: str, value: str | None, now_s: float) -> None:
        """Read a parameter, or set it.

        Args:
            name: as `sidestep serve --parameters` prints it; lower case will do.
            value: a number; None only reads.
            now_s: any clock.

        Raises:
            SettingsError: the name cannot be one, or the value is no number.
        """
        name = name.upper()
        if not _NAME.match(name):
            raise SettingsError(
                f"{name!r} is no parameter name", "`sidestep serve --parameters` and `locate set` list the names."
            )
        self._talks[name] = _Talk(None if value is None else _number(value), now_s)
        self.tick(now_s)

    def tick(self, now_s: float) -> None:
        """Ask again what was not answered; give up what never is."""
        for name, talk in list(self._talks.items()):
            if now_s < talk.deadline_s:
                continue
            if talk.sendings >= SENDINGS:
                del self._talks[name]
                self._tell(f"{name}: not answered; is that a parameter of sidestep serve, and does it run?")
                continue
            talk.sendings += 1
            talk.deadline_s = now_s + ANSWER_S
            try:
                request = self._request(name, talk)
            except (struct.error, ValueError):
                del self._talks[name]
                self._tell(f"{name}: {talk.wanted:g} cannot be its value: that is a whole number")
            else:
                self._send(request)

    def value(self, message: Message, now_s: float) -> None:
        """A PARAM_VALUE of the component."""
        name = _text(message.param_id)
        talk = self._talks.get(name)
        here = decoded(message.param_value, message.param_type, self._peer().encoding)
        if talk is None or here is None:
            return
        if talk.wanted is not None and talk.kind is None:
            talk.kind, talk.sendings, talk.deadline_s = message.param_type, 0, now_s
            self.tick(now_s)
            return
        del self._talks[name]
        if talk.wanted is None or _equal(here, talk.wanted):
            self._tell(f"{name} = {here:g}")
        else:
            self._tell(f"{name} stays {here:g}: {talk.wanted:g} was not taken (range, or this station may not set)")

    def _request(self, name: str, talk: _Talk) -> Message:
        peer = self._peer()
        if talk.wanted is None or talk.kind is None:
            return mavlink.MAVLink_param_request_read_message(peer.system, peer.component, name.encode(), -1)
        if talk.kind != mavlink.MAV_PARAM_TYPE_REAL32 and talk.wanted != int(talk.wanted):
            raise ValueError("a fraction")
        value = encoded(talk.wanted, talk.kind, peer.encoding)
        return mavlink.MAVLink_param_set_message(peer.system, peer.component, name.encode(), value, talk.kind)


def _number(text: str) -> float:
    words = {"true": 1.0, "false": 0.0}
    try:
        number = words.get(text.lower())
        number = float(text) if number is None else number
    except ValueError:
        number = None
    if number is None or math.isinf(number):
        raise SettingsError(f"{text!r} is no number", "Parameters over MAVLink are numbers; choices count from 0.")
    return number


def _equal(a: float, b: float) -> bool:
    return (math.isnan(a) and math.isnan(b)) or math.isclose(a, b, rel_tol=1e-6)


def _text(raw: str | bytes) -> str:
    return (raw if isinstance(raw, str) else raw.decode("ascii", "replace")).split("\0")[0]
