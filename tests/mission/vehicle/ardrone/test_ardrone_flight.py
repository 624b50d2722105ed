"""The pilot's rules on an AR.Drone: who may fly, what is flown by tilt, and what ends it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.planning.pattern import lateral_path
from mission.settings import PatternSettings
from mission.vehicle.ardrone.navdata_options import Control
from mission.vehicle.drone import Bounds, Knot, OrderState, Path
from tests.support.fake_ardrone import FakeArdrone


def _paper() -> Path:
    return lateral_path(PatternSettings(kind="paper"), 0.3)


def _out_and_back() -> Path:
    return lateral_path(PatternSettings(), 0.3)


def test_takes_off_climbs_and_lands_without_repeating_itself() -> None:
    drone = FakeArdrone()
    drone.flight.begin(Bounds(), drone.now_s)
    drone.done(drone.order("take-off", height_m=2.5))
    assert drone.place[2] == pytest.approx(2.5, abs=0.35)
    assert drone.state_name() == "HOVERING"
    refs = [c for _, c in drone.sent if c.name == "REF"]
    assert {c.arguments for c in refs} == {("290718208",)}
    assert {"FTRIM"} <= drone.names_since(0.0)
    settled = drone.now_s + 1.5
    drone.run(4.0)
    assert drone.names_since(settled) == {"COMWDG"}, "left alone, only the link is kept"
    drone.done(drone.order("land"))
    assert drone.state_name() == "LANDED"
    assert not drone.vehicle.armed
    settled = drone.now_s + 0.1
    drone.run(1.0)
    assert drone.names_since(settled) == {"COMWDG"}


def test_an_emergency_is_reset_by_the_next_take_off_and_by_nothing_else() -> None:
    drone = FakeArdrone().airborne()
    drone.done(drone.order("hover"))
    drone.cut_motors()
    drone.run(3.0)
    assert drone.state_name() == "LANDED"
    assert drone.in_emergency()
    assert any("Emergency" in text for text in drone.events("failsafe"))
    drone.flight.begin(Bounds(), drone.now_s)
    drone.done(drone.order("take-off", height_m=1.5))
    assert not drone.in_emergency()
    assert drone.state_name() == "HOVERING"
    assert sum(c.arguments == ("290717952",) for _, c in drone.sent) == 1


def test_nothing_flies_without_permission() -> None:
    drone = FakeArdrone()
    number = drone.order("take-off", height_m=2.0)
    assert drone.outcome(number)[0] is OrderState.REFUSED
    drone.run(1.0)
    assert drone.control == Control.LANDED
    assert "REF" not in drone.names_since(0.0)


@pytest.mark.parametrize(("wind", "within_m"), [(0.0, 0.45), (1.5, 0.6)])
def test_out_and_back_stays_near_its_path(wind: float, within_m: float) -> None:
    drone = FakeArdrone().airborne()
    drone.wind = np.array([wind, -wind])
    drone.run(1.0)
    drone.done(drone.order("hover"))
    start, began = drone.place.copy(), drone.now_s
    drone.flight.aim(0.3)
    number = drone.order("path", path=_out_and_back())
    furthest = 0.0
    while drone.outcome(number)[0] is OrderState.FLYING and drone.now_s < began + 20.0:
        drone.run(0.02)
        furthest = max(furthest, float(np.linalg.norm(drone.place[:2] - start[:2])))
    assert drone.outcome(number)[0] is OrderState.DONE, drone.outcome(number)
    assert furthest == pytest.approx(3.0, abs=within_m)
    assert np.linalg.norm(drone.place - start) < within_m
    assert abs(math.remainder(drone.heading - 0.3, math.tau)) < 0.1


def test_the_papers_pattern_travels_as_table_two_says() -> None:
    drone = FakeArdrone().airborne()
    drone.flight.begin(Bounds(radius_m=15.0, max_speed_m_s=4.0), drone.now_s)
    drone.done(drone.order("hover"))
    start = drone.place.copy()
    drone.order("path", path=_paper())
    drone.run(5.0)
    travel = float(np.linalg.norm(drone.place[:2] - start[:2]))
    assert travel == pytest.approx(8.42, rel=0.15)
    rolls = [int(c.arguments[1]) for _, c in drone.sent[-200:] if c.name == "PCMD" and c.arguments[0] == "1"]
    assert min(rolls) < 0, "rolled to the left"


def test_turns_to_a_heading_and_keeps_its_place() -> None:
    drone = FakeArdrone().airborne()
    drone.done(drone.order("hover"))
    start = drone.place.copy()
    drone.done(drone.order("turn", heading_rad=2.0))
    assert abs(math.remainder(drone.heading - 2.0, math.tau)) < math.radians(4.0)
    assert np.linalg.norm(drone.place - start) < 0.4


def test_a_path_beyond_the_bounds_is_refused() -> None:
    drone = FakeArdrone().airborne()
    drone.flight.begin(Bounds(radius_m=2.0), drone.now_s)
    drone.done(drone.order("hover"))
    state, reason = drone.outcome(drone.order("path", path=_out_and_back()))
    assert state is OrderState.REFUSED
    assert "bounds" in reason


def test_blown_out_of_its_bounds_it_hovers() -> None:
    drone = FakeArdrone().airborne()
    drone.flight.begin(Bounds(radius_m=1.0), drone.now_s)
    drone.done(drone.order("hover"))
    drone.place[:2] += 4.0
    drone.velocity[:2] = 5.0
    drone.run(0.5)
    assert drone.events("failsafe") != []
    ended = drone.now_s
    drone.run(0.2)
    assert "HOVER" in drone.names_since(ended)
    assert "PCMD" not in drone.names_since(ended)


def test_a_silent_program_makes_it_hover_within_half_a_second() -> None:
    drone = FakeArdrone().airborne()
    drone.done(drone.order("hover"))
    drone.flight.aim(0.3)
    number = drone.order("path", path=_out_and_back())
    drone.run(1.5)
    silent = drone.now_s
    drone.program_alive = False
    drone.run(0.6)
    assert drone.outcome(number)[0] is OrderState.ENDED
    assert drone.events("deadman") != []
    drone.run(1.0)
    assert "PCMD" not in drone.names_since(silent + 0.6), "no tilt any more"
    assert np.linalg.norm(drone.velocity) < 0.6


def test_without_navdata_there_is_no_tilt_and_the_order_ends() -> None:
    drone = FakeArdrone().airborne()
    drone.done(drone.order("hover"))
    number = drone.order("path", path=_out_and_back())
    drone.run(1.0)
    lost = drone.now_s
    drone.silent = True
    drone.run(1.0)
    assert "PCMD" not in drone.names_since(lost + 0.45)
    assert drone.outcome(number)[0] is OrderState.ENDED
    assert drone.events("link-lost") != []


@pytest.mark.parametrize("what", ["lands", "cuts the motors", "flips"])
def test_the_pilot_wins(what: str) -> None:
    drone = FakeArdrone().airborne()
    drone.done(drone.order("hover"))
    number = drone.order("path", path=_out_and_back())
    drone.run(1.0)
    if what == "lands":
        drone.control = Control.LANDING
    elif what == "cuts the motors":
        drone.emergency = True
    else:
        drone.control = Control.LOOPING
        drone._fly = lambda: None  # type: ignore[method-assign]  # the flip is not simulated
    taken = drone.now_s + 0.1
    drone.run(6.0)
    state, _ = drone.outcome(number)
    assert state is OrderState.ENDED
    assert drone.events("failsafe" if what == "cuts the motors" else "pilot") != []
    assert drone.names_since(taken) <= {"COMWDG", "HOVER"}
    assert not any(c.name == "REF" for t, c in drone.sent if t > taken), "never taken off again"
    refused, reason = drone.outcome(drone.order("hover"))
    assert refused is OrderState.REFUSED
    assert "begin" in reason


def test_hold_gives_it_back_and_then_only_the_link_is_kept() -> None:
    drone = FakeArdrone().airborne()
    drone.done(drone.order("hover"))
    drone.done(drone.order("hold"))
    drone.run(1.5)
    settled = drone.now_s
    drone.run(2.0)
    assert drone.names_since(settled) == {"COMWDG"}
    assert drone.control == Control.HOVERING


def test_a_path_ends_at_rest_even_when_it_was_cut_short() -> None:
    drone = FakeArdrone().airborne()
    drone.done(drone.order("hover"))
    path = Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(2.0, (2.0, 0, 0), (0, 0, 0))))
    drone.order("path", path=path)
    drone.run(1.0)
    drone.done(drone.order("hover"))
    assert np.linalg.norm(drone.velocity) < 0.4
