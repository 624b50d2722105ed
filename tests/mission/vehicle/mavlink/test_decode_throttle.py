"""Which telemetry is decoded: all while somebody looks, little otherwise, another vehicle's never."""

from __future__ import annotations

from collections import Counter
from typing import ClassVar, cast

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.decode_throttle import NEEDED_S, OTHERS_HZ, DecodeThrottle
from mission.vehicle.mavlink.framing import MESSAGE_IDS, frames
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.rates import MessageRates

ATTITUDE = mavlink.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)
POSITION = mavlink.MAVLink_global_position_int_message(1, 1, 1, 1, 1, 1, 1, 1, 1)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
START_S = 100.0


def packed(
    message: mavlink.MAVLink_message, source: tuple[int, int] = (1, 1), *, v1: bool = False
) -> tuple[int, bytes]:
    ((message_id, frame),) = frames(bytes(message.pack(mavlink.MAVLink(None, *source), force_mavlink1=v1)))
    return message_id, frame


def decoded(
    thinning: DecodeThrottle, frame: tuple[int, bytes], begin_s: float, seconds: float, hz: float = 50.0
) -> int:
    return sum(thinning.wants(*frame, begin_s + i / hz) for i in range(round(seconds * hz)))


def test_everything_is_decoded_at_first_and_after_somebody_looked() -> None:
    thinning = DecodeThrottle(1, START_S, sparing=True)
    assert decoded(thinning, packed(ATTITUDE), START_S, 4.0) == 200
    thinning.need(START_S + 60.0)
    assert decoded(thinning, packed(ATTITUDE), START_S + 60.0, 4.0) == 200
    assert not thinning.passed_over


def test_nothing_is_left_out_for_a_program_that_does_not_wait() -> None:
    thinning = DecodeThrottle(1, START_S, sparing=False)
    assert decoded(thinning, packed(ATTITUDE), START_S + 60.0, 4.0) == 200
    assert not thinning.at_leisure(START_S + 60.0)


@pytest.mark.parametrize("v1", [False, True])
def test_ten_a_second_are_decoded_when_nobody_looks_and_the_rest_are_counted(v1: bool) -> None:
    thinning = DecodeThrottle(1, START_S, sparing=True)
    idle_s = START_S + NEEDED_S
    found = [decoded(thinning, packed(message, v1=v1), idle_s, 10.0) for message in (ATTITUDE, POSITION)]
    assert found == [100, 100]
    assert dict(thinning.passed_over) == {"ATTITUDE": 400, "GLOBAL_POSITION_INT": 400}


def test_heartbeats_and_orders_are_always_decoded() -> None:
    thinning = DecodeThrottle(1, START_S, sparing=True)
    order = mavlink.MAVLink_command_long_message(1, 100, 31010, 0, 0, 0, 0, 0, 0, 0, 0)
    for message, source in ((HEARTBEAT, (1, 1)), (HEARTBEAT, (255, 190)), (order, (255, 190))):
        assert decoded(thinning, packed(message, source), START_S + 60.0, 1.0) == 50


def test_what_another_vehicle_reports_is_not_decoded_and_takes_no_ones_place() -> None:
    thinning = DecodeThrottle(1, START_S, sparing=True)
    assert decoded(thinning, packed(ATTITUDE, (2, 1)), START_S, 1.0) == 0
    assert decoded(thinning, packed(ATTITUDE, (1, 100)), START_S, 1.0) == 0
    idle_s = START_S + 60.0
    ours, others = packed(ATTITUDE), packed(ATTITUDE, (2, 1))
    kept = [(thinning.wants(*others, idle_s + 0.02 * i), thinning.wants(*ours, idle_s + 0.02 * i)) for i in range(50)]
    assert sum(other for other, _ in kept) == 0
    assert sum(our for _, our in kept) == 10
    assert MESSAGE_IDS["ATTITUDE"] == ours[0]


def test_the_rate_of_a_message_is_that_at_which_it_comes_however_many_are_decoded() -> None:
    thinning = DecodeThrottle(1, START_S, sparing=True)

    class Link:
        received: ClassVar[Counter[str]] = Counter({"ATTITUDE": 10})
        target_system = 0

    rates = MessageRates(cast(MavlinkLink, Link), {"ATTITUDE": 50.0}, START_S, thinning.passed_over)
    thinning.passed_over["ATTITUDE"] += 40
    rates.keep(START_S + 1.0)
    assert rates.hz("ATTITUDE") == pytest.approx(50.0)


def test_of_others_messages_a_bounded_number_is_decoded_and_the_vehicle_s_always() -> None:
    thinning = DecodeThrottle(1, START_S, sparing=False)
    assert decoded(thinning, packed(HEARTBEAT, (255, 190)), START_S, 2.0, hz=40_000.0) <= 3 * OTHERS_HZ
    assert thinning.wants(*packed(HEARTBEAT), START_S + 2.0)
    assert decoded(thinning, packed(HEARTBEAT, (255, 190)), START_S + 10.0, 20.0, hz=1.0) == 20


def test_each_kind_of_others_messages_has_its_own_bound_and_orders_have_none() -> None:
    thinning = DecodeThrottle(1, START_S, sparing=False)
    text = mavlink.MAVLink_statustext_message(6, b"text")
    order = mavlink.MAVLink_command_long_message(1, 100, 31011, 0, *([0.0] * 7))
    assert decoded(thinning, packed(HEARTBEAT, (255, 190)), START_S, 0.5, hz=4000.0) == OTHERS_HZ
    assert decoded(thinning, packed(text, (255, 190)), START_S, 0.5, hz=4000.0) == OTHERS_HZ
    assert decoded(thinning, packed(text), START_S, 0.5, hz=4000.0) == 2000
    assert decoded(thinning, packed(order, (255, 190)), START_S, 0.5, hz=4000.0) == 2000
