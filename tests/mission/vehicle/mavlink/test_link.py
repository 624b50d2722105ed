from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.errors import LinkError
from mission.vehicle.mavlink.framing import decode, frames
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.pilot.loopback import loopback_socket
from tests.support.tlog import ARDUCOPTER
from tests.support.tlog import frames as recorded

LOCATE = mavlink.MAV_CMD_USER_1


class Autopilot:
    """The far side of a link: sends what it is told to, and answers commands by a rule."""

    def __init__(self, port: int) -> None:
        self.sock = loopback_socket()
        self.sock.settimeout(0.05)
        self.closed = False
        self.sock.connect(("127.0.0.1", port))
        self.mav = mavlink.MAVLink(None, 1, 1)
        self.seen: list[Any] = []
        self.answer: Callable[[Any], list[Any]] = lambda _: []
        self.beat()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def beat(self) -> None:
        self.say(mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 4, 3))

    def say(self, message: Any) -> None:
        self.sock.send(message.pack(self.mav))

    def close(self) -> None:
        self.closed = True
        self._thread.join(2.0)
        self.sock.close()

    def _run(self) -> None:
        while not self.closed:
            try:
                data = self.sock.recv(65535)
            except OSError:
                continue
            for _, frame in frames(data):
                message = mavlink.MAVLink(None).decode(bytearray(frame))
                self.seen.append(message)
                for reply in self.answer(message):
                    self.say(reply)


@pytest.fixture
def pair() -> Iterator[tuple[MavlinkLink, Autopilot]]:
    link = MavlinkLink(loopback_socket(), source_system=1, source_component=193)
    autopilot = Autopilot(link.port)
    _until(lambda: link.connected)
    yield link, autopilot
    link.close()
    autopilot.close()


def _until(done: Callable[[], bool], timeout_s: float = 3.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not done():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def _ack(result: int, component: int = 193, command: int = LOCATE) -> Any:
    return mavlink.MAVLink_command_ack_message(command, result, 0, 0, 1, component)


def _commands(autopilot: Autopilot) -> list[Any]:
    return [m for m in autopilot.seen if m.get_type() == "COMMAND_LONG"]


def test_the_first_autopilot_becomes_the_target(pair: tuple[MavlinkLink, Autopilot]) -> None:
    link, _ = pair
    assert (link.target_system, link.target_component) == (1, 1)


def test_heartbeats_of_our_own_are_sent(pair: tuple[MavlinkLink, Autopilot]) -> None:
    _, autopilot = pair
    _until(lambda: any(m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 193 for m in autopilot.seen))


def test_a_command_is_repeated_until_it_is_answered(pair: tuple[MavlinkLink, Autopilot]) -> None:
    link, autopilot = pair

    def deaf_at_first(message: Any) -> list[Any]:
        if message.get_type() != "COMMAND_LONG" or message.confirmation < 2:
            return []
        return [_ack(mavlink.MAV_RESULT_DENIED)]

    autopilot.answer = deaf_at_first
    assert link.command(LOCATE, [1.5], timeout_s=0.1) == mavlink.MAV_RESULT_DENIED
    assert [m.confirmation for m in _commands(autopilot)] == [0, 1, 2]
    assert _commands(autopilot)[0].param1 == 1.5


def test_in_progress_is_waited_for_and_not_repeated(pair: tuple[MavlinkLink, Autopilot]) -> None:
    link, autopilot = pair

    def slow(message: Any) -> list[Any]:
        if message.get_type() == "COMMAND_LONG":
            threading.Timer(0.4, autopilot.say, [_ack(mavlink.MAV_RESULT_ACCEPTED)]).start()
            return [_ack(mavlink.MAV_RESULT_IN_PROGRESS)]
        return []

    autopilot.answer = slow
    assert link.command(LOCATE, [], timeout_s=0.1, retries=2) == mavlink.MAV_RESULT_ACCEPTED
    assert len(_commands(autopilot)) == 1


def test_acks_for_others_and_of_other_commands_are_passed_over(pair: tuple[MavlinkLink, Autopilot]) -> None:
    link, autopilot = pair

    def chatty(message: Any) -> list[Any]:
        if message.get_type() != "COMMAND_INT":
            return []
        return [_ack(4, component=191), _ack(4, command=400), _ack(mavlink.MAV_RESULT_ACCEPTED)]

    autopilot.answer = chatty
    assert link.command_int(LOCATE, [1, 2], 372276000, 1268405000, 30.0) == mavlink.MAV_RESULT_ACCEPTED
    sent = next(m for m in autopilot.seen if m.get_type() == "COMMAND_INT")
    assert (sent.x, sent.y, sent.z) == (372276000, 1268405000, 30.0)


def test_a_command_that_nobody_answers_is_an_error(pair: tuple[MavlinkLink, Autopilot]) -> None:
    link, _ = pair
    with pytest.raises(LinkError, match="MAV_CMD_USER_1"):
        link.command(LOCATE, [], timeout_s=0.03, retries=1)


def test_a_mailbox_gets_its_types_only_and_keeps_the_newest(pair: tuple[MavlinkLink, Autopilot]) -> None:
    link, autopilot = pair
    with link.listen("ATTITUDE", size=3) as box:
        for i in range(5):
            autopilot.say(mavlink.MAVLink_attitude_message(i, 0, 0, 0, 0, 0, 0))
            autopilot.beat()
        _until(lambda: link.received["ATTITUDE"] == 5)
        assert [box.get(1.0).time_boot_ms for _ in range(3)] == [2, 3, 4]  # type: ignore[union-attr]
        assert box.lost == 2
        assert box.get(0.01) is None
    with pytest.raises(ValueError, match="NONSENSE"), link.listen("NONSENSE"):
        pass


def test_messages_go_out_as_the_component_that_is_asked_for(pair: tuple[MavlinkLink, Autopilot]) -> None:
    link, autopilot = pair
    link.send(mavlink.MAVLink_statustext_message(6, b"locate: done"), source_component=100)
    _until(lambda: any(m.get_type() == "STATUSTEXT" for m in autopilot.seen))
    assert next(m for m in autopilot.seen if m.get_type() == "STATUSTEXT").get_srcComponent() == 100


def test_strangers_and_garbage_do_no_harm(pair: tuple[MavlinkLink, Autopilot]) -> None:
    link, autopilot = pair
    rng = random.Random(5)
    whole = [frame for _, frame in recorded(ARDUCOPTER)][:300]
    stranger = loopback_socket()
    with link.listen("ATTITUDE", "GLOBAL_POSITION_INT", "STATUSTEXT", "PARAM_VALUE"):
        for i, frame in enumerate(whole):
            broken = bytearray(frame)
            broken[rng.randrange(len(broken))] ^= 1 << rng.randrange(8)
            autopilot.sock.send(bytes(broken))
            autopilot.sock.send(frame[: rng.randrange(1, len(frame))])
            autopilot.sock.send(rng.randbytes(rng.randrange(1, 300)))
            stranger.sendto(frame, ("127.0.0.1", link.port))
            if i % 30 == 0:
                time.sleep(0.01)
        before = link.received["HEARTBEAT"]
        autopilot.beat()
        _until(lambda: link.received["HEARTBEAT"] > before)
    assert link.rejected > 100
    stranger.close()


def test_sending_to_nobody_neither_blocks_nor_raises() -> None:
    link = MavlinkLink(loopback_socket(), source_system=1, source_component=193)
    link.send(mavlink.MAVLink_statustext_message(6, b"hello"))
    assert link.dropped >= 1
    link.close()
    link.close()
    link.send(mavlink.MAVLink_statustext_message(6, b"hello"))


def test_frames_are_found_between_rubbish_and_truncated_ones_are_not() -> None:
    whole = [frame for _, frame in recorded(ARDUCOPTER)][:20]
    data = b"\x00\x01" + b"\x07".join(whole) + whole[0][:-1]
    found = [frame for _, frame in frames(data)]
    assert found[:20] == whole
    assert all(decode(mavlink.MAVLink(None), f) is not None for f in found[:20])
    assert decode(mavlink.MAVLink(None), whole[0][:-1]) is None
