"""Rates, acks, routing between peers, losses, and bytes that are no MAVLink."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.telemetry import BUILDERS, build, sends
from tests.support.autopilot_bench import Bench, Peer, setpoint

ATTITUDE: int = mavlink.MAVLINK_MSG_ID_ATTITUDE


def test_every_message_can_be_packed_and_read_back(bench: Bench) -> None:
    for message_id in BUILDERS[bench.autopilot.flavour.name]:
        if not sends(bench.autopilot, message_id):
            continue
        bench.peer.received.clear()
        bench.peer.link.send(build(bench.autopilot, message_id))
        assert [m.get_msgId() for m in bench.peer.received] == [message_id]


def test_ardupilot_streams_little_until_it_is_asked(ardupilot: Bench) -> None:
    ardupilot.run(10.5)
    assert {m.get_type() for m in ardupilot.peer.received} == {"HEARTBEAT", "TIMESYNC", "STATUSTEXT"}


def test_px4_streams_position_and_attitude_unasked(px4: Bench) -> None:
    px4.run(2.0)
    assert {"GLOBAL_POSITION_INT", "ATTITUDE", "HOME_POSITION", "EXTENDED_SYS_STATE"} <= {
        m.get_type() for m in px4.peer.received
    }


@pytest.mark.parametrize("hz", [20.0, 50.0, 100.0])
def test_the_rate_asked_for_is_the_rate_that_comes(bench: Bench, hz: float) -> None:
    assert bench.peer.ask_rate(ATTITUDE, hz) == 0
    bench.peer.received.clear()
    bench.run(2.0)
    assert len(bench.peer.of("ATTITUDE")) == pytest.approx(2.0 * hz, abs=2)


def test_200_hz_is_exact_on_ardupilot_and_124_on_px4(bench: Bench) -> None:
    bench.peer.ask_rate(ATTITUDE, 200.0)
    bench.peer.received.clear()
    bench.run(2.0)
    expected = 248 if bench.autopilot.flavour.name == "px4" else 400
    assert len(bench.peer.of("ATTITUDE")) == pytest.approx(expected, rel=0.02)


def test_rates_are_per_link_and_can_be_read_and_stopped(bench: Bench) -> None:
    other = Peer(bench.autopilot, 254)
    other.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE, -1)
    bench.peer.ask_rate(ATTITUDE, 50.0)
    bench.run(1.0)
    assert len(bench.peer.of("ATTITUDE")) > 40
    assert other.of("ATTITUDE") == []
    bench.peer.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, ATTITUDE)
    assert bench.peer.of("MESSAGE_INTERVAL")[-1].interval_us == 20000


def test_a_message_it_does_not_have_is_refused_as_on_the_real_one(bench: Bench) -> None:
    sim_state = mavlink.MAVLINK_MSG_ID_SIM_STATE  # the truth is not told on the wire
    ack = bench.peer.ask_rate(sim_state, 50.0)
    assert ack == (4 if bench.autopilot.flavour.name == "px4" else 2)


def test_an_unknown_command_is_unsupported_and_a_repeated_one_is_answered_again(bench: Bench) -> None:
    assert bench.peer.command(31999) == 3
    assert [bench.peer.command(mavlink.MAV_CMD_DO_CHANGE_SPEED) for _ in range(3)] == [0, 0, 0]


def test_the_ack_goes_to_who_asked(bench: Bench) -> None:
    other = Peer(bench.autopilot, 42, 191)
    other.command(mavlink.MAV_CMD_DO_CHANGE_SPEED)
    ack = other.of("COMMAND_ACK")[0]
    assert (ack.target_system, ack.target_component) == (42, 191)
    assert bench.peer.of("COMMAND_ACK") == []


def test_commands_for_another_component_are_routed_once_it_was_heard(bench: Bench) -> None:
    camera = Peer(bench.autopilot, 1, 100)
    order = mavlink.MAVLink_command_long_message(1, 100, 31010, 0, 0, 0, 0, 0, 0, 0, 0)
    bench.peer.send(order)
    assert len(bench.peer.of("COMMAND_ACK")) == 1  # not heard yet: the autopilot takes it for its own
    camera.send(mavlink.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3))
    bench.peer.received.clear()
    bench.peer.send(order)
    assert len(camera.of("COMMAND_LONG")) == 1
    assert bench.peer.of("COMMAND_ACK") == []


def test_time_since_boot_is_unrelated_to_the_programs_clock_and_timesync_answers_in_it(bench: Bench) -> None:
    bench.peer.ask_rate(ATTITUDE, 50.0)
    bench.run(0.5)
    boot_ms = bench.peer.of("ATTITUDE")[-1].time_boot_ms
    assert abs(boot_ms / 1e3 - bench.now) > 100.0
    bench.peer.send(mavlink.MAVLink_timesync_message(0, 77))
    answer = next(m for m in bench.peer.of("TIMESYNC") if m.ts1 == 77)
    assert answer.tc1 / 1e6 == pytest.approx(bench.autopilot.boot_ms, abs=2.0)


def test_a_lossy_link_loses_and_a_cut_one_is_silent(px4: Bench) -> None:
    px4.peer.ask_rate(ATTITUDE, 100.0)
    px4.peer.link.loss = 0.3
    px4.peer.received.clear()
    px4.run(4.0)
    assert len(px4.peer.of("ATTITUDE")) == pytest.approx(280, abs=40)
    px4.peer.link.cut = True
    px4.peer.received.clear()
    px4.run(1.0)
    assert px4.peer.received == []
    assert px4.peer.command(mavlink.MAV_CMD_DO_CHANGE_SPEED) is None


def test_parameters_are_listed_read_and_set(bench: Bench) -> None:
    px4 = bench.autopilot.flavour.name == "px4"
    name = "COM_OBL_RC_ACT" if px4 else "FENCE_ACTION"
    bench.peer.send(mavlink.MAVLink_param_request_list_message(1, 1))
    bench.run(0.2)
    listed = bench.peer.of("PARAM_VALUE")
    assert len(listed) == listed[0].param_count == len({m.param_index for m in listed})
    raw = mavlink.struct.unpack("<f", mavlink.struct.pack("<i", 5))[0] if px4 else 5.0
    bench.peer.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), raw, mavlink.MAV_PARAM_TYPE_INT32))
    assert bench.autopilot.parameters.number(name) == 5
    bench.peer.received.clear()
    bench.peer.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    assert bench.peer.of("PARAM_VALUE")[-1].param_value == pytest.approx(raw)
    bench.peer.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    bench.peer.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH", 1.0, 9))


def test_unknown_parameters_in_the_configuration_are_refused() -> None:
    with pytest.raises(KeyError, match="no parameter NONSENSE"):
        Bench(AutopilotConfig(parameters=(("NONSENSE", 1.0),)))


_FUZZ = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@_FUZZ
@given(data=st.lists(st.binary(max_size=300), max_size=5))
def test_any_bytes_at_all_leave_it_alive(data: list[bytes]) -> None:
    bench = _shared("px4")
    for chunk in data:
        bench.autopilot.receive(bench.peer.link, chunk)
        bench.autopilot.receive(bench.peer.link, b"\xfd" + chunk)
    _still_answers(bench)


@_FUZZ
@given(cut=st.integers(0, 60), flip=st.integers(0, 59), flavour=st.sampled_from(["px4", "ardupilot"]))
def test_truncated_and_damaged_packets_leave_it_alive(cut: int, flip: int, flavour: str) -> None:
    bench = _shared(flavour)
    packed = bytearray(bench.peer.pack(setpoint(velocity_ned=(1.0, 0.0, 0.0), yaw=0.0)))
    bench.autopilot.receive(bench.peer.link, bytes(packed[:cut]))
    packed[flip % len(packed)] ^= 0xFF
    bench.autopilot.receive(bench.peer.link, bytes(packed))
    _still_answers(bench)


_NUMBERS = st.sampled_from([0.0, 1.0, -1.0, 1e9, -1e38, 65535.0, math.nan, math.inf, -math.inf])


@_FUZZ
@given(
    command=st.sampled_from(sorted(c for c in mavlink.enums["MAV_CMD"] if c < 33000)),
    params=st.tuples(*[_NUMBERS] * 7),
    flavour=st.sampled_from(["px4", "ardupilot"]),
    wide=st.booleans(),
)
def test_any_command_with_any_numbers_is_answered(
    command: int, params: tuple[float, ...], flavour: str, wide: bool
) -> None:
    bench = _shared(flavour)
    bench.peer.received.clear()
    if wide:
        message: Any = mavlink.MAVLink_command_int_message(
            1, 1, 3, command, 0, 0, *params[:4], 2**31 - 1, -(2**31), params[6]
        )
    else:
        message = mavlink.MAVLink_command_long_message(1, 1, command, 0, *params)
    bench.peer.send(message)
    assert bench.peer.of("COMMAND_ACK")
    _still_answers(bench)


@_FUZZ
@given(
    mask=st.integers(0, 65535),
    frame=st.integers(0, 255),
    numbers=st.tuples(*[_NUMBERS] * 11),
    flavour=st.sampled_from(["px4", "ardupilot"]),
)
def test_any_setpoint_leaves_it_alive(mask: int, frame: int, numbers: tuple[float, ...], flavour: str) -> None:
    bench = _shared(flavour)
    bench.peer.send(mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *numbers))
    where = (2**31 - 1, -(2**31), *numbers[2:])
    bench.peer.send(mavlink.MAVLink_set_position_target_global_int_message(0, 1, 1, frame, mask, *where))
    _still_answers(bench)


_benches: dict[str, Bench] = {}


def _shared(flavour: str) -> Bench:
    """One flying aircraft for all examples: damage done by one would show in the next."""
    if flavour not in _benches:
        bench = Bench(AutopilotConfig(flavour="px4" if flavour == "px4" else "ardupilot"))
        bench.hover()
        _benches[flavour] = bench
    return _benches[flavour]


def _still_answers(bench: Bench) -> None:
    bench.run(0.02)
    for _ in range(3):  # the first may be swallowed by the start of a packet that never ends
        if bench.peer.command(mavlink.MAV_CMD_DO_CHANGE_SPEED) == 0:
            return
        for _ in range(12):
            bench.autopilot.receive(bench.peer.link, bytes(30))
    pytest.fail("it does not answer any more")
