"""Messages that come too seldom are asked for again, more and more seldom, and the operator is told once."""

from __future__ import annotations

from collections import Counter
from typing import Any, cast

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.rates import MessageRates


class Link:
    """Gives each message at a rate, and counts the requests."""

    target_system, target_component = 1, 1

    def __init__(self) -> None:
        self.received: Counter[str] = Counter()
        self.asked_s: list[float] = []
        self.now_s = 0.0

    def send(self, message: Any) -> None:
        assert message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        self.asked_s.append(self.now_s)


def run(rates: MessageRates, link: Link, seconds: float, hz: float) -> list[str]:
    """What was told meanwhile."""
    told = []
    for _ in range(int(seconds * 10)):
        link.now_s += 0.1
        for name in rates.wanted:
            link.received[name] += round(hz / 10)
        rates.keep(link.now_s)
        if text := rates.shortfall():
            told.append(text)
    return told


def made() -> tuple[MessageRates, Link]:
    link = Link()
    return MessageRates(cast(MavlinkLink, link), {"ATTITUDE": 50.0}, 0.0), link


def test_a_link_that_gives_less_is_asked_a_few_times_in_two_minutes_and_told_once() -> None:
    rates, link = made()
    told = run(rates, link, 120.0, 10.0)
    assert 3 <= len(link.asked_s) <= 7
    assert link.asked_s[2] < 10.0
    assert told == ["this link gives 10 of 50 Hz of ATTITUDE; it is asked more seldom from now on"]
    run(rates, link, 600.0, 10.0)
    assert len(link.asked_s) <= 18


def test_what_comes_is_not_asked_for_and_not_told() -> None:
    rates, link = made()
    assert run(rates, link, 3.0, 50.0) == []
    before = len(link.asked_s)
    assert run(rates, link, 300.0, 50.0) == []
    assert len(link.asked_s) == before


def test_what_came_and_is_turned_down_is_asked_for_at_once_again() -> None:
    rates, link = made()
    run(rates, link, 200.0, 10.0)
    run(rates, link, 60.0, 50.0)
    before = len(link.asked_s)
    run(rates, link, 3.0, 10.0)
    assert len(link.asked_s) > before


def test_a_rate_that_is_turned_down_again_and_again_makes_no_storm() -> None:
    rates, link = made()
    for _ in range(30):
        run(rates, link, 2.0, 50.0)
        run(rates, link, 2.0, 10.0)
    assert len(link.asked_s) <= 8
