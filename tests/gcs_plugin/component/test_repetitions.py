"""A repeated command starts nothing a second time, and is answered again."""

from __future__ import annotations

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component import LocateOrder, NextCandidate
from gcs_plugin.component.acknowledgements import MOST_REMEMBERED, CommandAnswer, Memory, ReceivedCommand, Sender
from tests.support.component_bench import Bench

USER_1, USER_3, RECTANGLE = 31010, 31012, 2005
BOX = (0.1, 0.1, 0.5, 0.5)


def test_a_box_sent_again_as_it_was_is_accepted_again_while_it_runs() -> None:
    bench = Bench()
    bench.command(RECTANGLE, *BOX)
    assert isinstance(bench.turn(), LocateOrder)
    bench.command(RECTANGLE, *BOX)
    bench.step(3.0)
    assert bench.acks() == [(RECTANGLE, 0), (RECTANGLE, 0)]
    assert not bench.component.should_stop()


def test_a_button_sent_again_hears_how_far_the_order_is() -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.turn()
    bench.component.progress(45)
    bench.take()
    bench.command(USER_1, confirmation=1)
    bench.step(0.1)
    (ack,) = bench.take("COMMAND_ACK")
    assert (ack.result, ack.progress) == (mavlink.MAV_RESULT_IN_PROGRESS, 45)


def test_the_last_answer_is_given_again_to_a_sender_that_missed_it() -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.turn()
    bench.component.ended(mavlink.MAV_RESULT_FAILED)
    bench.take()
    bench.command(USER_1, confirmation=1)
    assert bench.turn(10.0) is None
    assert bench.acks() == [(USER_1, mavlink.MAV_RESULT_FAILED)]


def test_the_same_button_pressed_again_later_is_a_new_order() -> None:
    bench = Bench()
    bench.command(USER_1)
    bench.turn()
    bench.component.ended(mavlink.MAV_RESULT_ACCEPTED)
    bench.command(USER_1)
    assert bench.turn(6.0) == LocateOrder()


def test_a_refused_order_given_again_is_looked_at_again() -> None:
    bench = Bench()
    bench.refusal = "the vehicle is not armed and airborne"
    bench.command(USER_1)
    assert bench.turn() is None
    bench.refusal = ""
    bench.command(USER_1)
    assert bench.turn(1.0) == LocateOrder()


def test_the_same_command_of_another_sender_is_another_command() -> None:
    bench = Bench()
    bench.command(RECTANGLE, *BOX)
    bench.turn()
    bench.command(RECTANGLE, *BOX, source=(254, 190))
    bench.step()
    assert bench.acks() == [
        (RECTANGLE, mavlink.MAV_RESULT_ACCEPTED),
        (RECTANGLE, mavlink.MAV_RESULT_TEMPORARILY_REJECTED),
    ]


def test_the_next_candidate_can_be_asked_for_again_and_again() -> None:
    bench = Bench()
    for _ in range(3):
        bench.command(USER_3)
        assert bench.turn(1.0) == NextCandidate()
        bench.component.ended(0)


def test_the_memory_is_bounded_and_keeps_what_runs() -> None:
    memory = Memory()
    running = ReceivedCommand(Sender(255, 190), USER_1, (0.0,) * 7, 0)
    memory.remember(CommandAnswer(running, mavlink.MAV_RESULT_IN_PROGRESS, 0.0, running=True))
    for i in range(1000):
        memory.remember(CommandAnswer(ReceivedCommand(Sender(i % 255, i // 255), USER_1, (float(i),) * 7, 0), 0, 0.0))
    assert len(memory) == MOST_REMEMBERED
    assert memory.repeated(running, 1000.0) is not None
