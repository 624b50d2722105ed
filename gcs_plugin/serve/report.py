"""What happens in a flight, told to the component and to the answer."""

from __future__ import annotations

from typing import Final

from gcs_plugin.component import CameraComponent
from gcs_plugin.component.tracking import TrackedBox
from mission.procedure.result import LocateResult, Stage, Watcher
from mission.records import FlightSightings, Frame
from mission.track import Track

PERCENT: Final[dict[Stage, int]] = {
    Stage.DETECT: 5,
    Stage.HOVER: 10,
    Stage.CENTRE: 25,
    Stage.SIDESTEP: 45,
    Stage.REPOSITION: 60,
    Stage.ESTIMATE: 85,
    Stage.REPORT: 95,
    Stage.HOLD: 97,
}
"""How far an order has come at each stage, in percent of the time that a flight usually takes."""


class Report:
    """`Watcher` that tells the component, and another one.

    Args:
        component: shows the target and the progress to stations.
        other: the answer, which stores and publishes.
    """

    def __init__(self, component: CameraComponent, other: Watcher) -> None:
        self._component = component
        self._other = other

    def stage(self, stage: Stage, text: str) -> None:
        """A new stage: progress."""
        self._component.progress(PERCENT[stage])
        self._other.stage(stage, text)

    def frame(self, frame: Frame, track: Track | None) -> None:
        """A frame with the target: its box."""
        if track is not None:
            height, width = frame.image.shape[:2]
            self._component.tracking(TrackedBox(track, width, height))
        self._other.frame(frame, track)

    def sightings(self, flight: FlightSightings) -> None:
        """The sightings."""
        self._other.sightings(flight)

    def located(self, located: LocateResult) -> None:
        """The answer."""
        self._other.located(located)

    def keep(self, located: LocateResult) -> None:
        """Store the answer."""
        self._other.keep(located)
