"""What ends a flight while something else is waited for; whoever is asked about an abort is asked on meanwhile."""

from __future__ import annotations

import itertools
import threading

import pytest

from mission.errors import EstimateRefused, LinkError
from mission.procedure.flight_loop import FlightLoop
from mission.vehicle.drone import OrderState
from tests.support.fakes import FRAME_S, FakeDrone, FakeOrder, FakeVideo


class SlowToHold(FakeDrone):
    """Its hold is confirmed after two seconds."""

    def advance(self, dt: float) -> None:
        super().advance(dt)
        if self.order is not None and self.order.kind == "hold" and self.t_s < (self.order.started_s or 0.0) + 2.0:
            self.order.state = OrderState.FLYING


def release_control(drone: FakeDrone) -> tuple[str, list[float]]:
    """What is said of it, and when the stations were served meanwhile."""
    served: list[float] = []

    def serve() -> None:
        served.append(drone.t_s)

    loop = FlightLoop(drone, FakeVideo(drone), lambda: True, lambda: drone.t_s, lambda _: None, serve)
    loop.fly(FakeOrder("hover"))
    return loop.release_control(), served


def test_stations_are_served_while_the_hold_is_confirmed() -> None:
    said, served = release_control(SlowToHold())
    assert said == ""
    assert len(served) >= 30
    gaps = [later - earlier for earlier, later in itertools.pairwise(served)]
    assert max(gaps) <= 2 * FRAME_S


def test_a_hold_that_nobody_confirms_is_told_in_the_end() -> None:
    class Deaf(SlowToHold):
        def advance(self, dt: float) -> None:
            super().advance(dt)
            if self.order is not None:
                self.order.state = OrderState.FLYING

    said, served = release_control(Deaf())
    assert said == "no answer"
    assert served


def test_work_that_fails_after_the_flight_was_ended_tells_both() -> None:
    drone, told = FakeDrone(), threading.Event()
    drone.seize("link-lost", "the link loses 41 % of the packets")

    def aborted() -> bool:
        told.set()
        return False

    def refuse() -> None:
        assert told.wait(10.0)
        raise EstimateRefused("0 usable sightings are too few", "Keep the target in view.")

    loop = FlightLoop(drone, FakeVideo(drone), aborted, lambda: drone.t_s, lambda _: None)
    with pytest.raises(LinkError, match="loses 41 % of the packets; 0 usable sightings"):
        loop.through(refuse)
