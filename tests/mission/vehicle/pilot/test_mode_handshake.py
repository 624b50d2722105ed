"""How long control is waited for: longer where the link is known to lose packets."""

from __future__ import annotations

import pytest

from mission.vehicle.drone import OrderState
from mission.vehicle.path_follower import Setpoint
from mission.vehicle.pilot.controls import Answer, Ordered
from mission.vehicle.pilot.mode_handshake import Entering
from mission.vehicle.state.modes import FlightMode, ModeKind
from mission.vehicle.state.vehicle_state import VehicleState

HOLD = FlightMode("hold", "Hold")


class Deaf:
    """Controls of an autopilot that never carries out an order; it notes when each was given."""

    def __init__(self, answer: Answer) -> None:
        self.now_s = 0.0
        self.asked_s: list[float] = []
        self._answer = answer

    def ask_mode(self, kind: ModeKind, attempt: int) -> None:
        assert (kind, attempt) == ("offboard", len(self.asked_s))
        self.asked_s.append(self.now_s)

    def arm(self, attempt: int) -> None: ...

    def take_off(self, height_m: float, attempt: int) -> None: ...

    def answer(self, order: Ordered, since_s: float) -> Answer:
        return self._answer

    def complaint(self) -> str:
        return ""

    def setpoint(self, setpoint: Setpoint, yaw_rad: float) -> None: ...

    def release(self) -> None: ...


@pytest.mark.parametrize(("answer", "patience_s"), [("silent", 3.0), ("refused", 3.0), ("lossy", 8.0)])
def test_the_mode_is_waited_for_longer_on_a_link_that_loses_packets(answer: Answer, patience_s: float) -> None:
    vehicle, controls, entering = VehicleState(), Deaf(answer), Entering(HOLD, 0.0)
    vehicle.mode = HOLD
    ended_s = None
    while ended_s is None and controls.now_s < 20.0:
        controls.now_s += 0.02
        vehicle.mode_s = float(int(controls.now_s))  # a heartbeat a second
        outcome = entering.step(vehicle, controls, controls.now_s)
        if outcome is not None:
            assert outcome.state is OrderState.REFUSED
            ended_s = controls.now_s
    assert ended_s == pytest.approx(patience_s, abs=0.05)
    assert len(controls.asked_s) == {"silent": 1, "refused": 5, "lossy": 8}[answer]
