"""The pilot process without a vehicle: its pipes, its answers, its end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path as FilePath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.errors import LinkError, SettingsError
from mission.vehicle.drone import Bounds, Knot, OrderState, Path
from mission.vehicle.mavlink.mavlink_drone import MavlinkDrone
from mission.vehicle.mavlink.pilot_config import PilotConfig
from mission.vehicle.pilot.loopback import loopback_socket
from mission.vehicle.pilot.process import PilotProcess
from mission.vehicle.pilot.protocol import Begin, FlyOrder, OrderReport, decode_from_pilot, decode_to_pilot, encode


def _url() -> str:
    with loopback_socket() as sock:
        return f"udpin://127.0.0.1:{sock.getsockname()[1]}"


def test_orders_and_reports_survive_the_pipe() -> None:
    path = Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(2.0, (1.0, 0, 0), (0, 0, 0))))
    for line in (FlyOrder(id=3, kind="path", path=path), Begin(bounds=Bounds(radius_m=7.0))):
        assert decode_to_pilot(encode(line)) == line
    report = OrderReport(id=3, state=OrderState.ENDED, reason="pilot", t_s=12.5)
    assert decode_from_pilot(encode(report)) == report


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"{",
        b'{"type":"aim","heading_rad":NaN}',
        b'{"type":"aim"}',
        b'{"type":"fire"}',
        b'{"type":"order","id":1,"kind":"loop"}',
        b'{"type":"order","id":1,"kind":"path","path":{"knots":[{"t_s":1}]}}',
        b'{"type":"keep-alive","extra":1}',
    ],
)
def test_lines_that_are_none_are_none(line: bytes) -> None:
    assert decode_to_pilot(line) is None
    assert decode_from_pilot(line) is None


@given(st.binary(max_size=200))
def test_any_bytes_are_no_error(line: bytes) -> None:
    decode_to_pilot(line)
    decode_from_pilot(line)


def test_no_autopilot_is_a_link_error_with_the_address() -> None:
    drone = MavlinkDrone(_url())
    with pytest.raises(LinkError, match="no autopilot is heard on udpin"):
        drone.connect(0.5)
    assert drone.pilot_pid is None
    with pytest.raises(LinkError, match="not connected"):
        drone.begin(Bounds())
    assert drone.hover().state is OrderState.REFUSED
    assert not drone.telemetry().connected
    assert drone.pose_at(time.monotonic()) is None
    drone.close()


def test_an_address_in_use_is_a_link_error() -> None:
    with loopback_socket() as sock:
        drone = MavlinkDrone(f"udpin://127.0.0.1:{sock.getsockname()[1]}")
        with pytest.raises(LinkError, match="cannot open"):
            drone.connect(2.0)


def test_nonsense_is_refused_before_anything_starts() -> None:
    with pytest.raises(SettingsError):
        MavlinkDrone("nonsense")


def test_a_killed_process_leaves_no_order_open() -> None:
    pilot = PilotProcess(PilotConfig(url=_url(), program_port=1, connect_timeout_s=30.0))
    order = pilot.order(FlyOrder(id=1, kind="hover"))
    os.kill(pilot.pid, signal.SIGKILL)
    deadline = time.monotonic() + 5.0
    while order.state is not OrderState.ENDED:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert pilot.order(FlyOrder(id=2, kind="hover")).state is OrderState.REFUSED
    assert not pilot.send(Begin(bounds=Bounds()))
    with pytest.raises(LinkError, match="ended before it was ready"):
        pilot.wait_ready(1.0)
    pilot.close()
    pilot.close()


def test_the_reason_reaches_the_operator_however_late_the_process_starts() -> None:
    pilot = PilotProcess(PilotConfig(url=_url(), program_port=1, connect_timeout_s=0.3))
    try:
        with pytest.raises(LinkError, match="no autopilot is heard on udpin"):
            pilot.wait_ready(0.0)
    finally:
        pilot.close()


def test_a_process_that_connects_ends_when_it_is_told_to() -> None:
    pilot = PilotProcess(PilotConfig(url=_url(), program_port=1, connect_timeout_s=60.0))
    began = time.monotonic()
    pilot.close(timeout_s=30.0)
    assert not pilot.alive
    assert time.monotonic() - began < 20.0


CONNECTING = """
import sys, time
from mission.vehicle.mavlink.pilot_config import PilotConfig
from mission.vehicle.pilot.process import PilotProcess
print(PilotProcess(PilotConfig(url=sys.argv[1], program_port=1, connect_timeout_s=120.0)).pid, flush=True)
time.sleep(120.0)
"""


def test_no_process_is_left_behind_when_the_program_is_killed_while_it_connects() -> None:
    program = subprocess.Popen([sys.executable, "-c", CONNECTING, _url()], stdout=subprocess.PIPE, text=True)
    with program:
        assert program.stdout is not None
        pilot_pid = int(program.stdout.readline())
        program.kill()
    deadline = time.monotonic() + 20.0
    while _runs(pilot_pid):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _runs(pid: int) -> bool:
    try:
        state = FilePath(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"
