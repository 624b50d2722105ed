"""What the program and its pilot process tell each other: one JSON object a line over the process's stdin and stdout.

Times are `time.monotonic`, which all processes of a machine share.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from mission.vehicle.drone import Bounds, EventKind, OrderState, Path

MAX_LINE = 1_000_000
"""Longer lines are refused."""

OrderKind = Literal["take-off", "hover", "turn", "path", "hold", "land"]


class _Line(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class KeepAlive(_Line):
    """The program's own loop is alive."""

    type: Literal["keep-alive"] = "keep-alive"


class Begin(_Line):
    """The operator's permission to take control once, and the room for it."""

    type: Literal["begin"] = "begin"
    bounds: Bounds


class AimOrder(_Line):
    """The heading to keep from now on, radians clockwise from true north."""

    type: Literal["aim"] = "aim"
    heading_rad: float


class FlyOrder(_Line):
    """An order to fly; `id` comes back in every `OrderReport`."""

    type: Literal["order"] = "order"
    id: int
    kind: OrderKind
    height_m: float | None = None
    """For a take-off."""
    heading_rad: float | None = None
    """For a turn."""
    path: Path | None = None
    """For a path."""


class Quit(_Line):
    """Give control back and end."""

    type: Literal["quit"] = "quit"


class Ready(_Line):
    """The vehicle's connection is open and its autopilot is heard."""

    type: Literal["ready"] = "ready"
    system: int


class Failed(_Line):
    """The process cannot work and ends."""

    type: Literal["failed"] = "failed"
    cause: str
    remedy: str


class OrderReport(_Line):
    """How far an order has come."""

    type: Literal["order-report"] = "order-report"
    id: int
    state: OrderState
    reason: str = ""
    t_s: float


class EventReport(_Line):
    """Something happened."""

    type: Literal["event"] = "event"
    t_s: float
    kind: EventKind
    text: str


ToPilot = Annotated[KeepAlive | Begin | AimOrder | FlyOrder | Quit, Field(discriminator="type")]
FromPilot = Annotated[Ready | Failed | OrderReport | EventReport, Field(discriminator="type")]

_TO_PILOT: TypeAdapter[ToPilot] = TypeAdapter(ToPilot)
_FROM_PILOT: TypeAdapter[FromPilot] = TypeAdapter(FromPilot)


def encode(line: ToPilot | FromPilot) -> bytes:
    """One message as a line."""
    return line.model_dump_json().encode() + b"\n"


def decode_to_pilot(line: bytes) -> ToPilot | None:
    """A line for the pilot process; None when it is none."""
    try:
        return _TO_PILOT.validate_json(line)
    except ValidationError:
        return None


def decode_from_pilot(line: bytes) -> FromPilot | None:
    """A line from the pilot process; None when it is none."""
    try:
        return _FROM_PILOT.validate_json(line)
    except ValidationError:
        return None
