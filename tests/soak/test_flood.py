"""A signed abort is obeyed at once, however many unsigned frames come under the operator's id."""

from __future__ import annotations

import subprocess
import sys
import time
from datetime import UTC, datetime

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority
from gcs_plugin.authority.signing import timestamp_of
from gcs_plugin.component import CameraComponent, Identity, Locate, StationLink
from mission.drones.link import MavlinkLink
from mission.drones.loopback import loopback_socket
from mission.drones.thinning import Thinning
from mission.settings import MissionSettings
from tests.gcs_plugin.component.bench import PICTURE
from tests.soak.conftest import Note

pytestmark = [pytest.mark.soak, pytest.mark.timeout(120)]

KEY = bytes(range(32))
RATE_HZ = 40_000.0
TRIALS = 20
MOST_S = 0.5
LOOP_S = 0.05


def signed(command: int, number: int) -> bytes:
    """A command of the operator."""
    sender = mavlink.MAVLink(None, 255, 190)
    sender.signing.secret_key, sender.signing.sign_outgoing = KEY, True
    sender.signing.timestamp = timestamp_of(datetime.now(UTC))
    message = mavlink.MAVLink_command_long_message(1, 100, command, number % 256, *([0.0] * 7))
    return bytes(message.pack(sender))


def test_a_signed_abort_under_a_flood_of_unsigned_frames(note: Note) -> None:
    station, sock = loopback_socket(), loopback_socket()
    port = sock.getsockname()[1]
    thinning = Thinning(1, time.monotonic(), sparing=False)
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
    fd = station.fileno()
    command = [sys.executable, "-m", "tests.soak.flooder", str(fd), str(port), str(RATE_HZ), str(3.0 * TRIALS)]
    took_s, sent_stops = [], []
    with component, subprocess.Popen(command, pass_fds=[fd], stdout=subprocess.PIPE, text=True) as flood:
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
            assert order == Locate()
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
        flood.terminate()
        rates_hz = [float(line) for line in flood.communicate(timeout=10.0)[0].splitlines()]
    link.close()
    station.close()
    note("signed abort under 40,000 unsigned frames/s, s", took_s)
    note("times it was sent", [float(n) for n in sent_stops])
    note("frames sent a second", rates_hz[-1:])
    note("part of them that was read and turned away", [authority.turned_away / (rates_hz[-1] * len(rates_hz))])
    assert rates_hz[-1] > 0.95 * RATE_HZ
    assert max(took_s) < MOST_S
