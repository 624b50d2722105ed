"""A ground station and the component on a link without wires; time moves when told to."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority
from gcs_plugin.component import CameraComponent, Identity, Order, Picture
from gcs_plugin.component.identity import ParameterEncoding
from mission.settings import MissionSettings

Message = Any
STATION = (255, 190)
PICTURE = Picture(640, 480, 1.1, "rtsp://camera/stream")


class Inbox:
    def __init__(self, messages: deque[Message]) -> None:
        self._messages = messages

    def get(self, timeout_s: float) -> Message | None:
        return self._messages.popleft() if self._messages else None


class Wire:
    """`ComponentLink`: what the component sends is kept as it arrives at a station."""

    target_system, target_component, source_system, source_component = 1, 1, 1, 100

    def __init__(self) -> None:
        self.answer: Message | None = None
        self.sent: list[Message] = []
        self.waiting: deque[Message] = deque()
        self.types: tuple[str, ...] = ()
        self._ours = mavlink.MAVLink(None, 1, 100)

    def send(self, message: Message) -> None:
        self.sent.append(mavlink.MAVLink(None).decode(bytearray(message.pack(self._ours))))

    @contextmanager
    def listen(self, *types: str, gate: Callable[[bytes, float], bool] | None = None) -> Iterator[Inbox]:
        self.types = types  # the gate is for floods, which no bench has: everything is let in
        yield Inbox(self.waiting)

    def command_int(self, command: int, params: Sequence[float], x: int, y: int, z: float, *, frame: int) -> int:
        raise AssertionError("the component gives no orders to the autopilot")


class Bench:
    """The component, and a station that talks to it."""

    def __init__(
        self,
        settings: MissionSettings | None = None,
        *,
        authority: Authority | None = None,
        encoding: ParameterEncoding = "bytewise",
    ) -> None:
        self.settings = settings or MissionSettings()
        self.now = 100.0
        self.wire = Wire()
        self.refusal = ""
        self.authority = authority or Authority(self.settings.authority)
        identity = Identity(1, 100, encoding, "1.2.3")
        self.component = CameraComponent(
            self.wire, identity, PICTURE, self.settings, self.authority, self._refusal, lambda: self.now
        )
        self.component.__enter__()

    def _refusal(self, order: Order) -> str:
        return self.refusal

    def say(self, message: Message, source: tuple[int, int] = STATION) -> None:
        """A message arrives, in its own bytes."""
        packed = message.pack(mavlink.MAVLink(None, *source))
        self.say_bytes(packed)

    def say_bytes(self, packed: bytes) -> None:
        message = mavlink.MAVLink(None).decode(bytearray(packed))
        if message.get_type() in self.wire.types:
            self.wire.waiting.append(message)

    def command(
        self,
        command: int,
        *params: float,
        confirmation: int = 0,
        target: tuple[int, int] = (1, 100),
        source: tuple[int, int] = STATION,
    ) -> None:
        seven = [*params, *([0.0] * 7)][:7]
        self.say(mavlink.MAVLink_command_long_message(*target, command, confirmation, *seven), source)

    def turn(self, seconds: float = 0.0) -> Order | None:
        """Time passes, then the loop comes round and takes the order that waits."""
        self.now += seconds
        return self.component.attend(0.0)

    def step(self, seconds: float = 0.0) -> None:
        """Time passes, then the loop comes round while an order runs."""
        self.now += seconds
        self.component.step()

    def take(self, *types: str) -> list[Message]:
        """What has been sent since the last call, of these types (all, when none is named)."""
        found = [m for m in self.wire.sent if not types or m.get_type() in types]
        self.wire.sent = [m for m in self.wire.sent if types and m.get_type() not in types]
        return found

    def acks(self) -> list[tuple[int, int]]:
        """(command, result) of the acknowledgements since the last call."""
        return [(m.command, m.result) for m in self.take("COMMAND_ACK")]

    def texts(self) -> str:
        """STATUSTEXTs since the last call, put together."""
        return "".join(m.text for m in self.take("STATUSTEXT"))
