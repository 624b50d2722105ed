"""A signed abort is obeyed at once, however many unsigned frames come under the operator's id."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority
from gcs_plugin.authority.signing import timestamp_of
from gcs_plugin.component import CameraComponent, Identity, LocateOrder, StationLink
from mission.settings import MissionSettings
from mission.vehicle.mavlink.decode_throttle import DecodeThrottle
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.pilot.loopback import loopback_socket
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.process import start_autopilot
from tests.soak.conftest import Note
from tests.support.component_bench import PICTURE
from tests.support.station import Station, until

pytestmark = [pytest.mark.soak, pytest.mark.timeout(240)]

KEY = bytes(range(32))
RATE_HZ = 40_000.0
TRIALS = 20
MOST_S = 0.5
LOOP_S = 0.05


def signed(command: int, number: int) -> bytes:
    """A command of the operator; one of another number is not taken for a repetition."""
    sender = mavlink.MAVLink(None, 255, 190)
    sender.signing.secret_key, sender.signing.sign_outgoing = KEY, True
    sender.signing.timestamp = timestamp_of(datetime.now(UTC))
    message = mavlink.MAVLink_command_long_message(1, 100, command, 0, *([0.0] * 6), float(number))
    return bytes(message.pack(sender))


def test_a_signed_stop_reaches_serve_through_its_connection(tmp_path: Path, note: Note) -> None:
    """The flood goes into the port that the pilot process has open: past MAVSDK, the pilot process and the program."""
    (tmp_path / "key").write_bytes(KEY)
    (tmp_path / "settings.toml").write_text(f'[authority]\nkey_file = "{tmp_path / "key"}"\n', "utf-8")
    autopilot = start_autopilot(AutopilotConfig(flavour="px4"))
    port = int(autopilot.url.rsplit(":", 1)[1])
    command = [sys.executable, "-m", "gcs_plugin", "serve", "--settings", str(tmp_path / "settings.toml")]
    command += ["--link", autopilot.url, "--folder", str(tmp_path)]
    took_s, sent_stops = [], []
    with (tmp_path / "said").open("wb") as said, subprocess.Popen(command, stdout=said, stderr=said) as serve:
        try:
            assert until(lambda: "serving" in (tmp_path / "said").read_text("utf-8"), 60.0)
            with Station(f"udpout://127.0.0.1:{port}", KEY) as station, loopback_socket() as sock:
                station.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
                assert until(lambda: station.found("HEARTBEAT"), 10.0)
                with flood(sock, port, 60.0):
                    time.sleep(2.0)  # it is at full speed
                    for number in range(TRIALS):
                        seconds, sent = acknowledged(station, number)
                        took_s.append(seconds)
                        sent_stops.append(sent)
        finally:
            serve.terminate()
            serve.wait(20.0)
            autopilot.stop()
    note("signed stop through serve's connection under 40,000 unsigned frames/s, s", took_s)
    note("times it was sent", sent_stops)
    assert max(took_s) < MOST_S


def acknowledged(station: Station, number: int) -> tuple[float, float]:
    """Seconds from a stop to its COMMAND_ACK, and how often it was sent, five times a second."""
    began_s, next_s, sent = time.monotonic(), 0.0, 0
    while len(station.results(mavlink.MAV_CMD_USER_2)) <= number:
        assert time.monotonic() - began_s < 10.0
        if time.monotonic() >= next_s:
            station.command(mavlink.MAV_CMD_USER_2)
            next_s, sent = time.monotonic() + 0.2, sent + 1
        time.sleep(0.002)  # looks again until the deadline
    seconds = time.monotonic() - began_s
    time.sleep(0.3)  # a repetition is answered, too
    return seconds, float(sent)


@contextmanager
def flood(sock: socket.socket, port: int, seconds: float) -> Iterator[None]:
    """A flood from a socket to a loopback port, at full rate until the end of the context."""
    fd = sock.fileno()
    command = [sys.executable, "-m", "tests.support.flooder", str(fd), str(port), str(RATE_HZ), str(seconds)]
    with subprocess.Popen(command, pass_fds=[fd], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield
            assert process.poll() is None, "it lasts as long as it is needed"
        finally:
            process.terminate()
            rates_hz = [float(line) for line in process.communicate(timeout=10.0)[0].splitlines()]
    assert rates_hz[-1] > 0.95 * RATE_HZ


def test_a_signed_abort_under_a_flood_of_unsigned_frames(note: Note) -> None:
    station, sock = loopback_socket(), loopback_socket()
    port = sock.getsockname()[1]
    thinning = DecodeThrottle(1, time.monotonic(), sparing=False)
    link = MavlinkLink(
        sock, source_system=1, source_component=193, target_system=1, heartbeat=False, wants=thinning.wants
    )
    station.sendto(
        mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 1)), ("127.0.0.1", port)
    )
    settings = MissionSettings()
    settings = settings.model_copy(
        update={"authority": settings.authority.model_copy(update={"flights_per_minute": 60.0})}
    )
    authority = Authority(settings.authority, KEY)
    component = CameraComponent(StationLink(link, 100), Identity(1), PICTURE, settings, authority, lambda _: "")
    took_s, sent_stops = [], []
    with component, flood(station, port, 4.0 * TRIALS):
        until_s = time.monotonic() + 1.0
        while time.monotonic() < until_s:  # it is at full speed
            component.step(LOOP_S)
        for number in range(TRIALS):
            component.attend(0.0)
            began_s, next_s, order = time.monotonic(), 0.0, None
            while order is None:
                assert time.monotonic() - began_s < 10.0
                if time.monotonic() >= next_s:
                    station.sendto(signed(mavlink.MAV_CMD_USER_1, number), ("127.0.0.1", port))
                    next_s = time.monotonic() + 0.2
                order = component.attend(LOOP_S)
            assert order == LocateOrder()
            began_s, next_s, stops = time.monotonic(), 0.0, 0
            while not component.should_stop():
                assert time.monotonic() - began_s < 10.0
                if time.monotonic() >= next_s:
                    station.sendto(signed(mavlink.MAV_CMD_USER_2, number), ("127.0.0.1", port))
                    next_s, stops = time.monotonic() + 0.2, stops + 1
                component.step(LOOP_S)
            took_s.append(time.monotonic() - began_s)
            sent_stops.append(stops)
            component.ended(0)
            until_s = time.monotonic() + 1.2
            while time.monotonic() < until_s:  # no faster than flights are allowed
                component.step(LOOP_S)
    link.close()
    station.close()
    note("signed abort under 40,000 unsigned frames/s, s", took_s)
    note("times it was sent", [float(n) for n in sent_stops])
    assert max(took_s) < MOST_S
