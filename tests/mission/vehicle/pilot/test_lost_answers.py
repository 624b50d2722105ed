"""Lost answers to our orders, and a pilot who acts after each of them: what he chose stays."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.drone import OrderState
from tests.support.wired_vehicle import ALL, Flavour, WiredVehicle

MODE: int = mavlink.MAV_CMD_DO_SET_MODE
ARM: int = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
TAKE_OFF: int = mavlink.MAV_CMD_NAV_TAKEOFF
FLAVOURS: tuple[Flavour, ...] = ("px4", "ardupilot")
DELAYS_S = (0.0, 0.02, 0.06, 0.1, 0.3, 0.5, 0.72, 1.0)
PILOTS: dict[Flavour, tuple[str, ...]] = {
    "px4": ("position", "hold", "return"),
    "ardupilot": ("loiter", "altitude", "return"),
}
HOME: dict[Flavour, str] = {"px4": "hold", "ardupilot": "loiter"}


def _entry(flavour: Flavour, lost: int, delay_s: float, mode: str) -> WiredVehicle:
    vehicle = WiredVehicle(flavour, HOME[flavour])
    vehicle.lose_answers = lost
    vehicle.pilot_acts(MODE, delay_s, lambda: vehicle.pilot_mode(mode))
    vehicle.begin()
    vehicle.order("hover")
    return vehicle


def _hold(flavour: Flavour, lost: int, delay_s: float, mode: str) -> WiredVehicle:
    vehicle = WiredVehicle(flavour, HOME[flavour])
    vehicle.begin()
    vehicle.order("hover")
    vehicle.run(1.5)
    assert vehicle.flight.phase == "flying"
    vehicle.lose_answers = lost
    vehicle.pilot_acts(MODE, delay_s, lambda: vehicle.pilot_mode(mode))
    vehicle.order("hold")
    return vehicle


def _land(flavour: Flavour, lost: int, delay_s: float, mode: str) -> WiredVehicle:
    vehicle = WiredVehicle(flavour, HOME[flavour])
    vehicle.begin()
    vehicle.lose_answers = lost
    vehicle.pilot_acts(MODE, delay_s, lambda: vehicle.pilot_mode(mode))
    vehicle.order("land")
    return vehicle


def _climb(
    flavour: Flavour, lost: int, command: int, delay_s: float, act: Callable[[WiredVehicle], None]
) -> WiredVehicle:
    vehicle = WiredVehicle(flavour, HOME[flavour], airborne=False)
    vehicle.lose_answers = lost
    vehicle.pilot_acts(command, delay_s, lambda: act(vehicle))
    vehicle.begin()
    vehicle.order("take-off", height_m=3.0)
    return vehicle


def _arm(flavour: Flavour, lost: int, delay_s: float, mode: str) -> WiredVehicle:
    del mode
    return _climb(flavour, lost, ARM, delay_s, WiredVehicle.pilot_disarms)


def _arm_then_mode(flavour: Flavour, lost: int, delay_s: float, mode: str) -> WiredVehicle:
    return _climb(flavour, lost, ARM, delay_s, lambda vehicle: vehicle.pilot_mode(mode))


def _take_off(flavour: Flavour, lost: int, delay_s: float, mode: str) -> WiredVehicle:
    return _climb(flavour, lost, TAKE_OFF, delay_s, lambda vehicle: vehicle.pilot_mode(mode))


SCENES = {
    "entry": _entry,
    "hold": _hold,
    "land": _land,
    "arm": _arm,
    "arm, mode": _arm_then_mode,
    "take-off": _take_off,
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("flavour", FLAVOURS)
def test_what_the_pilot_chose_is_never_changed_by_us(flavour: Flavour, scene: str) -> None:
    for lost, delay_s, mode in itertools.product((0, 1, 2, ALL), DELAYS_S, PILOTS[flavour]):
        if scene == "arm, mode" and mode == HOME["px4"]:
            continue  # it is in that mode: there is nothing to see
        vehicle = SCENES[scene](flavour, lost, delay_s, mode)
        vehicle.run(5.0)
        said = f"{lost} answers lost, {mode} {delay_s} s after: {vehicle.undone}, {vehicle.sent}"
        assert vehicle.acted_s is not None, said
        assert vehicle.undone == [], said


def _times(vehicle: WiredVehicle, command: int) -> list[float]:
    return [t_s for t_s, sent, _ in vehicle.sent if sent == command]


@pytest.mark.parametrize("lost", [1, 2, ALL])
@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_lost_answer_is_no_reason_to_order_again(flavour: Flavour, lost: int) -> None:
    vehicle = WiredVehicle(flavour, HOME[flavour], airborne=False)
    vehicle.lose_answers = lost
    vehicle.begin()
    climb = vehicle.order("take-off", height_m=3.0)
    vehicle.run(8.0)
    assert vehicle.last(climb).state is OrderState.DONE
    assert len(_times(vehicle, ARM)) == len(_times(vehicle, TAKE_OFF)) == 1
    vehicle.order("hover")
    vehicle.run(2.0)
    hold = vehicle.order("hold")
    vehicle.run(3.0)
    assert vehicle.last(hold).state is OrderState.DONE
    assert len(_times(vehicle, MODE)) == 2


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_an_order_that_was_lost_itself_goes_out_again(flavour: Flavour) -> None:
    vehicle = WiredVehicle(flavour, HOME[flavour])
    vehicle.lose_orders = 1
    vehicle.begin()
    vehicle.order("hover")
    vehicle.run(2.5)
    assert vehicle.flight.phase == "flying"
    vehicle.lose_orders = 1
    hold = vehicle.order("hold")
    vehicle.run(4.0)
    assert vehicle.last(hold).state is OrderState.DONE
    assert len(_times(vehicle, MODE)) == 4


@pytest.mark.parametrize("lost", [0, ALL])
@pytest.mark.parametrize("flavour", FLAVOURS)
def test_an_order_that_is_refused_or_lost_leaves_the_pilots_mode_alone(flavour: Flavour, lost: int) -> None:
    """A refused or a lost order to fly it, met in a mode that the pilot flies by hand."""
    mode = {"px4": "position", "ardupilot": "loiter"}[flavour]
    vehicle = WiredVehicle(flavour, mode)
    vehicle.lose_orders, vehicle.refuse = lost, lost == 0
    vehicle.begin()
    order = vehicle.order("hover")
    vehicle.run(8.0)
    assert vehicle.last(order).state is OrderState.REFUSED
    assert vehicle.mode == mode
    asked = {kind for _, command, kind in vehicle.sent if command == MODE}
    assert asked == {6.0 if flavour == "px4" else 4.0}, "nothing but the mode that flies setpoints was ordered"
    assert vehicle.flight.phase == "idle"


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_an_order_that_comes_late_after_all_is_undone(flavour: Flavour) -> None:
    vehicle = WiredVehicle(flavour, HOME[flavour])
    vehicle.lose_orders = ALL
    vehicle.begin()
    vehicle.order("hover")
    vehicle.run(3.1)
    assert vehicle.flight.phase == "holding"
    vehicle.lose_orders, vehicle.mode = 0, "offboard"
    vehicle.run(2.0)
    assert vehicle.mode == "hold"


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_a_loop_that_hangs_while_nothing_is_flown_leaves_the_pilots_mode_alone(flavour: Flavour) -> None:
    vehicle = WiredVehicle(flavour, HOME[flavour])
    vehicle.begin()
    vehicle.flight.order_hold_once()
    vehicle.run(1.0)
    assert vehicle.sent == []
    vehicle.order("hover")
    vehicle.run(1.0)
    vehicle.flight.order_hold_once()
    vehicle.run(1.0)
    assert vehicle.mode == "hold"
