"""Orders: what is flown, what is refused, and what the sender hears."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component import Follow, HandToAutopilot, LocateOrder, Mark, NextCandidate
from gcs_plugin.component.commands import CANCELLED
from gcs_plugin.component.orders import order_of
from mission.records import Box
from mission.settings import MissionSettings, OrderSettings
from mission.vehicle.mavlink.command_cancel import CommandCancel
from tests.support.component_bench import Bench

USER_1, USER_2, USER_3, USER_4, POINT, RECTANGLE, STOP = 31010, 31011, 31012, 31013, 2004, 2005, 2010
ACCEPTED, TEMPORARILY_REJECTED, DENIED, FAILED, IN_PROGRESS = 0, 1, 2, 4, 5
TRACK_ONLY = MissionSettings(orders=OrderSettings(box="track"))


def test_a_box_on_the_video_is_accepted_at_once_and_starts_a_locate() -> None:
    bench = Bench()
    bench.command(RECTANGLE, 0.25, 0.5, 0.5, 0.75)
    order = bench.turn()
    assert order == LocateOrder(Mark(0.25, 0.5, 0.5, 0.75))
    assert bench.acks() == [(RECTANGLE, ACCEPTED)]
    assert order.mark is not None
    assert order.mark.choice(640, 480).box == Box(160.0, 240.0, 160.0, 120.0)


def test_a_click_is_a_point() -> None:
    bench = Bench()
    bench.command(POINT, 0.25, 0.5, 0.1)
    order = bench.turn()
    assert isinstance(order, LocateOrder)
    assert order.mark is not None
    assert order.mark.choice(640, 480).point == (160.0, 240.0)


def test_a_box_only_tracks_when_the_settings_say_so() -> None:
    bench = Bench(TRACK_ONLY)
    bench.command(RECTANGLE, 0.25, 0.5, 0.5, 0.75)
    assert bench.turn() == Follow(Mark(0.25, 0.5, 0.5, 0.75))


@pytest.mark.parametrize(
    ("params", "mark"),
    [
        ((0.0, 0.0, 0.0, 0.0), None),
        ((math.nan, math.nan, math.nan, math.nan), None),
        ((0.2, 0.3, 0.0, 0.0), Mark(0.2, 0.3, 0.2, 0.3)),
        ((0.2, 0.3, 0.6, 0.7), Mark(0.2, 0.3, 0.6, 0.7)),
        ((0.6, 0.7, 0.2, 0.3), Mark(0.2, 0.3, 0.6, 0.7)),
        ((-0.5, 0.3, 0.5, 2.0), Mark(0.0, 0.3, 0.5, 1.0)),
    ],
)
def test_the_button_locates_a_marked_target_or_any(params: tuple[float, ...], mark: Mark | None) -> None:
    assert order_of(USER_1, params, box_locates=True) == LocateOrder(mark)


@pytest.mark.parametrize(
    ("command", "params"),
    [
        (POINT, (1.5, 0.5, 0.0)),
        (POINT, (math.nan, 0.5, 0.0)),
        (RECTANGLE, (0.5, 0.5, 0.5, 0.5)),
        (RECTANGLE, (0.1, 0.1, math.inf, 0.5)),
        (RECTANGLE, (2.0, 2.0, 3.0, 3.0)),
    ],
)
def test_a_mark_outside_the_picture_is_denied(command: int, params: tuple[float, ...]) -> None:
    bench = Bench()
    bench.command(command, *params)
    assert bench.turn() is None
    assert bench.acks() == [(command, DENIED)]
    assert "outside the picture" in bench.texts()


def test_the_button_hears_of_progress_until_the_end() -> None:
    bench = Bench()
    bench.command(USER_1)
    assert bench.turn() == LocateOrder()
    for second in range(1, 6):
        bench.component.progress(20 * second - 10)
        for _ in range(10):
            bench.step(0.1)
    bench.component.ended(ACCEPTED)
    acks = bench.take("COMMAND_ACK")
    assert [a.result for a in acks[:-1]] == [IN_PROGRESS] * (len(acks) - 1)
    assert acks[-1].result == ACCEPTED
    progress = [a.progress for a in acks[:-1]]
    assert progress == sorted(progress)
    assert (progress[0], progress[-1]) == (0, 90)
    assert len(progress) >= 6


def test_what_could_not_fly_is_refused_with_the_reason() -> None:
    bench = Bench()
    bench.refusal = "the vehicle is not armed and airborne"
    bench.command(RECTANGLE, 0.25, 0.5, 0.5, 0.75)
    assert bench.turn() is None
    assert bench.acks() == [(RECTANGLE, TEMPORARILY_REJECTED)]
    assert bench.texts() == "sidestep: refused: the vehicle is not armed and airborne"


def test_a_second_order_is_refused_while_one_flies_and_taken_after_it() -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.turn()
    bench.take()
    bench.command(RECTANGLE, 0.125, 0.125, 0.5, 0.5)
    bench.step()
    assert bench.acks() == [(RECTANGLE, TEMPORARILY_REJECTED)]
    assert "busy" in bench.texts()
    bench.component.ended(FAILED)
    assert bench.acks() == [(USER_1, FAILED)]
    bench.command(RECTANGLE, 0.125, 0.125, 0.5, 0.5)
    assert bench.turn() == LocateOrder(Mark(0.125, 0.125, 0.5, 0.5))


@pytest.mark.parametrize("command", [USER_2, STOP])
def test_an_abort_ends_the_flight_and_the_button_hears_of_it(command: int) -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.turn()
    assert not bench.component.should_stop()
    bench.command(command)
    bench.step()
    assert bench.component.should_stop()
    bench.component.ended(CANCELLED)
    assert [ack for ack in bench.acks() if ack[1] != IN_PROGRESS] == [(command, ACCEPTED), (USER_1, CANCELLED)]
    assert not bench.component.should_stop()


def test_an_abort_of_an_order_that_has_not_begun_withdraws_it() -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.command(USER_2)
    assert bench.turn() is None
    assert bench.acks()[1:] == [(USER_1, CANCELLED), (USER_2, ACCEPTED)]
    bench.command(USER_1)
    assert bench.turn() == LocateOrder()


def test_an_abort_without_an_order_is_accepted() -> None:
    bench = Bench()
    bench.command(STOP)
    bench.turn()
    assert bench.acks() == [(STOP, ACCEPTED)]


def test_tracking_gives_way_to_the_order_to_locate() -> None:
    bench = Bench(TRACK_ONLY)
    bench.command(USER_3)
    assert bench.turn() == NextCandidate()
    bench.command(USER_1)
    bench.step()
    assert bench.component.should_stop()
    bench.component.ended(CANCELLED)  # of the tracking: nobody waits for that
    assert bench.turn() == LocateOrder()
    assert not bench.component.should_stop()
    bench.component.ended(ACCEPTED)
    assert [a for a in bench.acks() if a[1] != IN_PROGRESS] == [(USER_3, ACCEPTED), (USER_1, ACCEPTED)]


def test_too_many_flights_in_a_minute_are_refused() -> None:
    bench = Bench()
    results = []
    for i in range(12):
        bench.command(RECTANGLE, 0.1, 0.1, 0.5, 0.5 + i / 100.0)
        bench.turn(0.5)
        bench.component.ended(FAILED)
        results += [result for _, result in bench.acks()]
    assert results.count(ACCEPTED) <= 4
    assert "too many flights" in bench.texts()


@pytest.mark.parametrize(("what", "roi", "waypoint"), [(0.0, True, True), (1.0, True, False), (2.0, False, True)])
def test_the_last_answer_is_given_to_the_autopilot_on_request(what: float, roi: bool, waypoint: bool) -> None:
    bench = Bench()
    bench.command(USER_4, what)
    assert bench.turn() == HandToAutopilot(roi, waypoint)
    bench.component.ended(ACCEPTED)
    assert bench.acks() == [(USER_4, IN_PROGRESS), (USER_4, ACCEPTED)]


def test_a_cancel_of_the_order_that_runs_ends_it_and_its_own_acknowledgement_says_so() -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.turn()
    bench.take()
    bench.say(CommandCancel(1, 100, USER_1))
    bench.step()
    assert bench.component.should_stop()
    bench.component.ended(CANCELLED)
    assert bench.acks() == [(USER_1, CANCELLED)]


def test_a_cancel_of_an_order_that_has_not_begun_withdraws_it() -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.say(CommandCancel(1, 100, USER_1))
    assert bench.turn() is None
    assert bench.acks()[-1] == (USER_1, CANCELLED)


def test_a_cancel_of_another_command_for_another_component_or_by_a_stranger_changes_nothing() -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.turn()
    bench.take()
    bench.say(CommandCancel(1, 100, RECTANGLE))
    bench.say(CommandCancel(1, 101, USER_1))
    bench.say(CommandCancel(1, 100, USER_1), source=(77, 190))
    bench.step()
    assert not bench.component.should_stop()
    assert bench.acks() == []
    assert "77/190 is not allowed" in bench.texts()


def test_a_cancel_that_comes_late_is_passed_over() -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.turn()
    bench.component.ended(0)
    bench.take()
    bench.say(CommandCancel(1, 100, USER_1))
    assert bench.turn() is None
    assert bench.acks() == []


def test_a_cancel_has_the_bytes_of_the_standard() -> None:
    definition = b"COMMAND_CANCEL uint16_t command uint8_t target_system uint8_t target_component "
    crc = mavlink.x25crc(definition).crc  # https://mavlink.io/en/guide/serialization.html#crc_extra
    assert CommandCancel.crc_extra == (crc & 0xFF) ^ (crc >> 8)
    packed = CommandCancel(1, 100, USER_1).pack(mavlink.MAVLink(None, 255, 190))
    assert packed[7:14] == bytes((80, 0, 0, *USER_1.to_bytes(2, "little"), 1, 100))
    message = mavlink.MAVLink(None).decode(bytearray(packed))
    assert (message.target_system, message.target_component, message.command) == (1, 100, USER_1)
