"""Polygons and circles of a fence plan: how far inside a place lies, how they are read, and what may be flown."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.fence import Fence, FenceArea
from mission.vehicle.mavlink.fence_plan import FencePlan, areas_of
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.pilot.loopback import loopback_socket
from tests.mission.vehicle.mavlink.test_safeguards import Guarded, _hover, _north, _wire

FENCE = mavlink.MAV_MISSION_TYPE_FENCE
INSIDE, OUTSIDE, ROUND, NOT_ROUND, BACK = 5001, 5002, 5003, 5004, 5000
SQUARE = ((-10.0, -10.0), (-10.0, 10.0), (10.0, 10.0), (10.0, -10.0))
HOOK = ((0.0, 0.0), (0.0, 10.0), (10.0, 10.0), (10.0, 8.0), (2.0, 8.0), (2.0, 0.0))
"""An L; north, east."""
DEG_M = 1.0 / 111_000.0


def area(inclusion: bool, corners: tuple[tuple[float, float], ...], radius_m: float = 0.0) -> FenceArea:
    return FenceArea(inclusion, np.array(corners), radius_m)


@pytest.mark.parametrize(
    ("place", "inside_m"),
    [
        ((1.0, 1.0), 1.0),
        ((1.0, 9.0), 1.0),
        ((5.0, 5.0), -3.0),
        ((-3.0, 5.0), -3.0),
        ((5.0, 9.5), 0.5),
        ((13.0, 14.0), -5.0),
    ],
)
def test_how_far_a_place_lies_inside_a_polygon_that_is_not_convex(place: tuple[float, float], inside_m: float) -> None:
    assert area(True, HOOK).inside_m(np.array([place]))[0] == pytest.approx(inside_m)
    assert area(True, HOOK[::-1]).inside_m(np.array([place]))[0] == pytest.approx(inside_m)


@given(st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)), st.floats(0.1, 30.0), st.floats(-math.pi, math.pi))
def test_a_polygon_of_many_corners_is_as_good_as_its_circle(
    place: tuple[float, float], radius_m: float, turned_rad: float
) -> None:
    at = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False) + turned_rad
    corners = radius_m * np.column_stack([np.cos(at), np.sin(at)])
    there = np.array([place])
    around = FenceArea(True, np.zeros((1, 2)), radius_m).inside_m(there)[0]
    assert FenceArea(True, corners).inside_m(there)[0] == pytest.approx(around, abs=1e-3 * radius_m)


def outside(fence: Fence, north: float, east: float, margin_m: float = 2.0) -> str | None:
    return fence.outside(np.array([north, east, -3.0]), 0.0, margin_m)


def test_inclusions_all_count_or_any_of_them_as_the_autopilot_has_it() -> None:
    two = (area(True, SQUARE), area(True, ((0.0, 15.0),), 10.0))
    every, any_one = Fence(np.zeros(2), areas=two), Fence(np.zeros(2), areas=two, any_inclusion=True)
    assert outside(every, 0.0, 7.5) is None
    assert "outside the circle" in str(outside(every, 0.0, 0.0))
    assert outside(any_one, 0.0, 0.0) is None
    assert "every area" in str(outside(any_one, 0.0, 24.0))
    assert "0.0 m outside every area" in str(outside(any_one, -10.01, 0.0)) or outside(any_one, -10.01, 0.0) is not None


def test_exclusions_are_kept_away_from_by_the_margin() -> None:
    fence = Fence(np.zeros(2), areas=(area(False, SQUARE), area(False, ((0.0, 30.0),), 5.0)))
    assert "3.0 m inside a polygon" in str(outside(fence, 7.0, 0.0))
    assert "1.0 m outside a polygon" in str(outside(fence, 11.0, 0.0))
    assert outside(fence, 12.1, 0.0) is None
    assert "circle" in str(outside(fence, 0.0, 24.0))


def item(seq: int, command: int, param1: float, lat: float, lon: float) -> Any:
    numbers = [param1, 0.0, 0.0, 0.0]
    return _wire(
        mavlink.MAVLink_mission_item_int_message(
            1, 192, seq, 0, command, 0, 1, *numbers, round(lat * 1e7), round(lon * 1e7), 0.0, FENCE
        )
    )


def around(corners: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    """North and east of where `Guarded` hovers, as latitude and longitude."""
    return [(37.0 + n * DEG_M, 127.0 + e * DEG_M / math.cos(math.radians(37.0))) for n, e in corners]


def polygon(command: int, corners: tuple[tuple[float, float], ...], first: int = 0) -> list[Any]:
    return [item(first + i, command, len(corners), *place) for i, place in enumerate(around(corners))]


def test_a_plan_is_read_in_order() -> None:
    items = [*polygon(INSIDE, SQUARE), item(4, NOT_ROUND, 7.5, 37.0, 127.0), item(5, BACK, 0.0, 37.0, 127.0)]
    first, second = areas_of(items) or ()
    assert first.inclusion
    assert len(first.corners_deg) == 4
    assert not second.inclusion
    assert second.radius_m == 7.5


@pytest.mark.parametrize(
    "items",
    [
        polygon(INSIDE, SQUARE)[:3],
        [*polygon(INSIDE, SQUARE)[:2], *polygon(OUTSIDE, SQUARE)[:2]],
        [item(0, INSIDE, math.nan, 37.0, 127.0)],
        [item(0, INSIDE, 2.0, 37.0, 127.0), item(1, INSIDE, 2.0, 37.1, 127.0)],
        [item(0, ROUND, 0.0, 37.0, 127.0)],
        [item(0, ROUND, math.nan, 37.0, 127.0)],
        [item(0, ROUND, 10.0, 137.0, 127.0)],
        [item(0, 16, 10.0, 37.0, 127.0)],
    ],
)
def test_a_plan_that_is_none_is_told_from_an_empty_one(items: list[Any]) -> None:
    assert areas_of(items) is None
    assert areas_of([]) == ()


class Answering:
    """An autopilot with a plan, which answers what it is asked, but not always."""

    def __init__(self, items: list[Any], lost: tuple[int, ...] = ()) -> None:
        self.items, self.lost = items, list(lost)
        self.plan = FencePlan()
        self.link = MavlinkLink(loopback_socket(), source_system=1, source_component=192, target_system=1)
        self.asked: list[str] = []
        self.now_s = 0.0
        self.link.send = self._answer  # type: ignore[method-assign, assignment]  # in place of the wire

    def _answer(self, message: Any) -> None:
        self.asked.append(message.get_type())
        if len(self.asked) in self.lost:
            return
        if message.get_type() == "MISSION_REQUEST_LIST":
            self.told = mavlink.MAVLink_mission_count_message(1, 192, len(self.items), FENCE)
        elif message.get_type() == "MISSION_REQUEST_INT":
            self.told = self.items[message.seq]

    def run(self, until_s: float) -> None:
        while self.now_s < until_s and not self.plan.known:
            self.told = None
            self.plan.ask(self.link, self.now_s)
            if self.told is not None:
                self.plan.take(self.told if hasattr(self.told, "_header") else _wire(self.told))
            self.now_s += 0.02
        self.plan.ask(self.link, self.now_s)
        self.link.close()


def test_a_plan_comes_over_a_link_that_loses_answers() -> None:
    autopilot = Answering(polygon(OUTSIDE, SQUARE), lost=(1, 3, 4))
    autopilot.run(5.0)
    assert len(autopilot.plan.areas) == 1
    assert autopilot.plan.trouble == ""
    assert autopilot.asked[-1] == "MISSION_ACK"
    assert autopilot.now_s < 2.0


def test_an_autopilot_that_never_answers_is_silent_and_one_that_stops_is_trouble() -> None:
    mute = Answering([], lost=tuple(range(100)))
    mute.run(10.0)
    assert (mute.plan.known, mute.plan.silent, mute.plan.trouble) == (True, True, "")
    stopping = Answering(polygon(OUTSIDE, SQUARE), lost=tuple(range(3, 100)))
    stopping.run(10.0)
    assert stopping.plan.trouble == "1 of the 4 items of its plan came"


def test_what_is_no_fence_plan_is_passed_over() -> None:
    plan = FencePlan()
    plan.take(_wire(mavlink.MAVLink_mission_count_message(1, 192, 3, mavlink.MAV_MISSION_TYPE_MISSION)))
    plan.take(item(0, ROUND, 5.0, 37.0, 127.0))
    plan.take(_wire(mavlink.MAVLink_mission_ack_message(1, 192, mavlink.MAV_MISSION_DENIED, FENCE)))
    assert not plan.known
    plan.take(_wire(mavlink.MAVLink_mission_ack_message(1, 192, mavlink.MAV_MISSION_UNSUPPORTED, FENCE)))
    assert (plan.known, plan.areas, plan.trouble) == (True, (), "")


class Planned(Guarded):
    """Its autopilot has a fence plan, and a cylinder that is too wide to matter."""

    def __init__(self, autopilot: Any, items: list[Any], **changes: float) -> None:
        wide = {"GF_MAX_HOR_DIST": 500.0} if autopilot == "px4" else {"FENCE_RADIUS": 500.0}
        super().__init__(autopilot, **{**wide, **changes})
        self.safeguards.order_begins()
        self.safeguards.take(_wire(mavlink.MAVLink_mission_count_message(1, 192, len(items), FENCE)))
        for each in items:
            self.safeguards.take(each)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_pattern_that_would_leave_or_enter_an_area_is_refused(autopilot: str) -> None:
    ahead = ((5.0, -5.0), (5.0, 5.0), (9.0, 5.0), (9.0, -5.0))
    vehicle = Planned(autopilot, [*polygon(INSIDE, SQUARE), *polygon(OUTSIDE, ahead, 4)])
    vehicle.airborne()
    assert _hover(vehicle) == ""
    assert "a polygon that the autopilot's geofence forbids" in vehicle.reason_of(
        vehicle.order("path", path=_north(4.0))
    )
    assert "the polygon that the autopilot's geofence allows" in vehicle.reason_of(
        vehicle.order("path", path=_north(-9.0))
    )
    order = vehicle.order("path", path=_north(2.5))
    vehicle.run(0.1)
    assert vehicle.reason_of(order) == ""


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_nothing_flies_inside_an_area_that_is_forbidden(autopilot: str) -> None:
    vehicle = Planned(autopilot, polygon(OUTSIDE, SQUARE))
    assert "forbids" in _hover(vehicle.airborne())
    grounded = Planned(autopilot, polygon(OUTSIDE, SQUARE))
    grounded.begin()
    assert "take-off would leave the geofence" in grounded.reason_of(grounded.order("take-off", height_m=3.0))


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_plan_that_cannot_be_understood_refuses_the_flight(autopilot: str) -> None:
    vehicle = Planned(autopilot, polygon(OUTSIDE, SQUARE)[:2])
    assert "cannot be checked: its plan cannot be understood" in _hover(vehicle.airborne())


def test_areas_count_only_where_the_fence_and_its_polygons_are_on() -> None:
    assert _hover(Planned("px4", polygon(OUTSIDE, SQUARE), GF_ACTION=0.0).airborne()) == ""
    assert _hover(Planned("ardupilot", polygon(OUTSIDE, SQUARE), FENCE_TYPE=3.0).airborne()) == ""
    assert _hover(Planned("ardupilot", polygon(OUTSIDE, SQUARE), FENCE_ENABLE=0.0).airborne()) == ""
