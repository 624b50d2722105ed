"""Orders are sent until they are answered, and followed to their end."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.mavproxy.arguments import ABORT, LOCATE, TypedOrder
from gcs_plugin.mavproxy.order_book import ANSWER_S, CANCELLED, PROGRESS_S, SENDINGS, OrderBook
from mission.errors import SettingsError


class Station:
    def __init__(self) -> None:
        self.sent: list[tuple[int, int]] = []
        self.told: list[str] = []
        self.book = OrderBook(lambda order, sendings: self.sent.append((order.command, sendings)), self.told.append)

    def ack(self, command: int, result: int, now_s: float, progress: int = 0) -> None:
        self.book.ack(mavlink.MAVLink_command_ack_message(command, result, progress), now_s)


@pytest.fixture
def station() -> Station:
    return Station()


def test_an_order_that_nobody_answers_is_repeated_with_its_count_and_given_up(station: Station) -> None:
    station.book.place(TypedOrder(LOCATE), 100.0)
    for i in range(1, 100):
        station.book.tick(100.0 + 0.1 * i)
    assert station.sent == [(LOCATE, i) for i in range(SENDINGS)]
    assert station.told == ["locate: nothing answered; is `sidestep serve` running on this vehicle?"]
    assert station.book.summary() == ""


@pytest.mark.parametrize(
    ("result", "told"),
    [
        (mavlink.MAV_RESULT_ACCEPTED, "locate: done"),
        (CANCELLED, "locate: aborted"),
        (mavlink.MAV_RESULT_TEMPORARILY_REJECTED, "locate: refused"),
        (mavlink.MAV_RESULT_FAILED, "locate: failed"),
        (mavlink.MAV_RESULT_UNSUPPORTED, "locate: not known to this component"),
        (mavlink.MAV_RESULT_COMMAND_LONG_ONLY, "locate: command long only"),
        (99, "locate: 99"),
    ],
)
def test_the_answer_ends_it_in_the_operators_words(station: Station, result: int, told: str) -> None:
    station.book.place(TypedOrder(LOCATE), 0.0)
    station.ack(LOCATE, result, 0.1)
    station.book.tick(0.1 + ANSWER_S)
    assert station.told == [told]
    assert len(station.sent) == 1


def test_an_order_in_progress_is_not_repeated_and_says_how_far_it_is(station: Station) -> None:
    station.book.place(TypedOrder(LOCATE), 0.0)
    for second in range(1, 30):
        station.ack(LOCATE, mavlink.MAV_RESULT_IN_PROGRESS, float(second), 3 * second)
        station.book.tick(second + 0.5)
    assert len(station.sent) == 1
    assert station.told == ["locate: accepted, in progress"]
    assert station.book.summary() == "locate 87 %"
    with pytest.raises(SettingsError, match=r"locate runs already \(87 %\)"):
        station.book.place(TypedOrder(LOCATE), 30.0)


def test_an_abort_goes_out_while_a_locate_runs(station: Station) -> None:
    station.book.place(TypedOrder(LOCATE), 0.0)
    station.ack(LOCATE, mavlink.MAV_RESULT_IN_PROGRESS, 0.1, 20)
    station.book.place(TypedOrder(ABORT), 0.2)
    station.ack(LOCATE, CANCELLED, 0.3)
    station.ack(ABORT, mavlink.MAV_RESULT_ACCEPTED, 0.4)
    assert station.sent == [(LOCATE, 0), (ABORT, 0)]
    assert station.told[1:] == ["locate: aborted", "abort: done"]


def test_silence_in_flight_is_told(station: Station) -> None:
    station.book.place(TypedOrder(LOCATE), 0.0)
    station.ack(LOCATE, mavlink.MAV_RESULT_IN_PROGRESS, 1.0)
    station.book.tick(1.0 + PROGRESS_S)
    assert station.told[-1] == "locate: no news for 10 s; look at the aircraft"


def test_answers_to_nobodys_order_are_passed_over(station: Station) -> None:
    station.ack(LOCATE, mavlink.MAV_RESULT_ACCEPTED, 0.0)
    assert station.told == []


def test_orders_end_with_the_serve_that_carried_them_out(station: Station) -> None:
    station.book.place(TypedOrder(LOCATE), 0.0)
    station.ack(LOCATE, mavlink.MAV_RESULT_IN_PROGRESS, 0.1)
    station.book.forget()
    assert station.told[-1] == "locate: ended with sidestep serve"
    station.book.place(TypedOrder(LOCATE), 1.0)
    assert station.book.summary() == "locate sent"
