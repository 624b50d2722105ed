"""What an order to locate asks for, how its progress is told, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from mission.bundle import BundleSolution
from mission.procedure.flight_record import KeyFrame
from mission.records import Box, Estimate, FlightSightings, Frame, Matrix
from mission.timing.time_offset import TimeOffset
from mission.track import Track


class Stage(Enum):
    """Where the procedure is."""

    DETECT = "detect"
    HOVER = "hover"
    CENTRE = "centre"
    SIDESTEP = "sidestep"
    ESTIMATE = "estimate"
    REPORT = "report"
    REPOSITION = "reposition"
    HOLD = "hold"


@dataclass(frozen=True, slots=True)
class TargetChoice:
    """Which of the people in view is meant; with neither, the one nearest the image centre."""

    box: Box | None = None
    point: tuple[float, float] | None = None

    def __str__(self) -> str:
        """In the operator's words."""
        if self.box is not None:
            return f"the operator's box around ({self.box.centre_px[0]:.0f}, {self.box.centre_px[1]:.0f}) px"
        if self.point is not None:
            return f"the operator's point ({self.point[0]:.0f}, {self.point[1]:.0f}) px"
        return "the person nearest the image centre"


@dataclass(frozen=True, slots=True, eq=False)
class LocateResult:
    """A finished sidestep: the answer and all that decided it."""

    flight: FlightSightings
    estimate: Estimate
    comparisons: tuple[Estimate, ...]
    """The closed forms on the same sightings, where they apply."""
    geodetic: bool
    """Whether the flight's origin is a real place."""
    offset: TimeOffset | None
    drone_track: Matrix
    """Rows of time, east, north, up; shape (n, 4)."""
    key_frames: tuple[KeyFrame, ...]
    target_picture: bytes | None
    last_frame_s: float
    """Program time of the last frame of the pattern."""
    steadied: BundleSolution | None = None
    """The camera's poses by the background, or why they could not be had."""
    as_reported: FlightSightings | None = None
    """The same sightings with the poses that the aircraft reported, where the background's were used."""
    ended: str = ""
    """Why the flight ended while the answer was worked out, when it did: the aircraft is no longer ours."""


class Watcher(Protocol):
    """Who is told of what happens. Called from the procedure's own thread: keep it short."""

    def stage(self, stage: Stage, text: str) -> None:
        """A new stage, or news of the present one."""
        ...

    def frame(self, frame: Frame, track: Track | None) -> None:
        """A frame was used."""
        ...

    def sightings(self, flight: FlightSightings) -> None:
        """The sightings of a flight, before they are estimated from: keep them whatever follows."""
        ...

    def located(self, located: LocateResult) -> None:
        """The answer: tell it at once. Called in the flight's own loop like the others: nothing in it may wait."""
        ...

    def keep(self, located: LocateResult) -> None:
        """Store the answer that was told. Called in another thread, where it may wait."""
        ...
