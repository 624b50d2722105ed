"""Somebody else's AT commands win: another client lands the simulated AR.Drone, and cuts its motors."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import pytest

from mission.drones.ardrone.ardrone import ARDrone
from mission.drones.drone import Bounds, DroneEvent, Knot, Order, OrderState, Path
from sitl.ardrone import ArdroneConfig, start_ardrone

pytestmark = [pytest.mark.flight, pytest.mark.soak]

FINAL = (OrderState.DONE, OrderState.REFUSED, OrderState.ENDED)
FAR = Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(8.0, (4.0, 0, 0), (0, 0, 0))))


def test_another_client_lands_it_and_cuts_its_motors() -> None:
    simulated = start_ardrone(ArdroneConfig(at_port=0, navdata_port=0, video_port=0, control_port=0, seed=9))
    drone = ARDrone(simulated.url)
    other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def until(done: Callable[[], bool], timeout_s: float = 25.0) -> list[DroneEvent]:
        events: list[DroneEvent] = []
        deadline = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < deadline, events
            events += drone.events()
            time.sleep(0.02)
        return events + drone.events()

    def final(order: Order) -> list[DroneEvent]:
        return until(lambda: order.state in FINAL)

    def send(line: str) -> None:
        other.sendto(line.encode(), ("127.0.0.1", simulated.ports.at))

    def landed() -> bool:
        return not drone.telemetry().in_air

    try:
        drone.connect(20.0)
        drone.begin(Bounds(min_height_m=0.8))
        final(drone.take_off(1.2))
        hover = drone.hover()
        final(hover)
        assert hover.state is OrderState.DONE, hover.reason
        flown = drone.fly(FAR)
        send("AT*REF=1,290717696\r")  # sequence 1 is always taken
        events = final(flown)
        assert flown.state is OrderState.ENDED
        assert "Landing" in flown.reason
        events += until(landed)
        assert any(event.kind == "pilot" for event in events)
        refused = drone.take_off(1.2)
        final(refused)
        assert refused.state is OrderState.REFUSED, "never without a new order"
        assert landed()

        drone.begin(Bounds(min_height_m=0.8))
        again = drone.take_off(1.2)
        final(again)
        assert again.state is OrderState.DONE, again.reason
        final(drone.hover())
        flown = drone.fly(FAR)
        send("AT*REF=1,290717952\rAT*REF=2,290717696\r")
        events = final(flown) + until(landed)
        assert flown.state is OrderState.ENDED
        assert any(event.kind == "failsafe" and "Emergency" in event.text for event in events)

        drone.begin(Bounds(min_height_m=0.8))
        again = drone.take_off(1.2)
        final(again)
        assert again.state is OrderState.DONE, f"the take-off resets the emergency: {again.reason}"
        final(drone.land())
        assert landed()
    finally:
        other.close()
        drone.close()
        simulated.stop()
