"""What happens in a flight, told to the console's desk and to the answer."""

from __future__ import annotations

from gcs_plugin.console.desk import ConsoleDesk
from gcs_plugin.publish.publisher import AnswerPublisher
from mission.procedure.result import LocateResult, Stage
from mission.records import FlightSightings, Frame
from mission.track import Track


class ConsoleWatcher:
    """`Watcher` that tells the console, and another one.

    Args:
        desk: the console's.
        other: which stores and publishes.
    """

    def __init__(self, desk: ConsoleDesk, other: AnswerPublisher) -> None:
        self._desk = desk
        self._other = other

    def stage(self, stage: Stage, text: str) -> None:
        """A new stage."""
        self._desk.stage(stage, text)
        self._other.stage(stage, text)

    def frame(self, frame: Frame, track: Track | None) -> None:
        """A frame, with the target's box."""
        self._desk.frame(frame, track)
        self._other.frame(frame, track)

    def sightings(self, flight: FlightSightings) -> None:
        """The sightings."""
        self._other.sightings(flight)

    def located(self, located: LocateResult) -> None:
        """The answer."""
        self._other.located(located)
        if located.geodetic:
            self._desk.measured(located.flight)
        if self._other.geotag is not None:
            self._desk.targets.tell(self._other.geotag)

    def keep(self, located: LocateResult) -> None:
        """Store the answer."""
        self._other.keep(located)
