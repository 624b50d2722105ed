"""A station like QGroundControl behind a real MAVProxy (`--out`): its orders arrive, and the answers find back."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.camera import camera as client
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.framing import decode, frames
from sitl.autopilot import AutopilotConfig, start_autopilot
from tests.support.mavproxy_process import MavProxy

pytest.importorskip("MAVProxy", reason="MAVProxy is not installed (pip install .[mavproxy])")

USER_1, USER_3, REQUEST_MESSAGE = 31010, 31012, 512
ACCEPTED, TEMPORARILY_REJECTED, DENIED = 0, 1, 2
STATION, CAMERA = (255, 190), (1, 100)


@dataclass
class Ports:
    """Where MAVProxy sends what it hears from the vehicle."""

    pymavlink: int
    mavsdk: int


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


@pytest.fixture(scope="module")
def ports(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ports]:
    """The vehicle, `sidestep serve` beside it, and MAVProxy on the operator's link."""
    folder = tmp_path_factory.mktemp("behind")
    autopilot = start_autopilot(AutopilotConfig(noise="none"))
    options = [
        "--link",
        autopilot.url,
        "--folder",
        str(folder / "flights"),
        "--video",
        f"udp://127.0.0.1:{free_port()}",
    ]
    serve = subprocess.Popen([sys.executable, "-m", "gcs_plugin", "serve", *options], stdout=subprocess.DEVNULL)
    found = Ports(free_port(), free_port())
    outs = [part for port in (found.pymavlink, found.mavsdk) for part in ("--out", f"127.0.0.1:{port}")]
    proxy = MavProxy(autopilot.operator_url, folder, *outs)
    try:
        proxy.expect("online system 1")
        yield found
    finally:
        proxy.close()
        serve.terminate()
        serve.wait(20.0)
        autopilot.stop()


@dataclass
class Station:
    """Speaks to whoever sends to its port, as a ground station does."""

    sock: socket.socket
    source: tuple[int, int] = STATION
    heard: list[Any] = field(default_factory=list)

    def hear(self, wanted: Callable[[Any], bool], timeout_s: float = 20.0) -> Any:
        """The first message of the camera component that is wanted."""
        deadline = time.monotonic() + timeout_s
        self.sock.settimeout(0.1)
        while time.monotonic() < deadline:
            try:
                data, self.peer = self.sock.recvfrom(65535)
            except TimeoutError:
                continue
            for _, frame in frames(data):
                message = decode(mavlink.MAVLink(None), frame)
                if message is None or (message.get_srcSystem(), message.get_srcComponent()) != CAMERA:
                    continue
                self.heard.append(message)
                if wanted(message):
                    return message
        raise AssertionError(f"it did not come, but {[m.get_type() for m in self.heard]}")

    def order(self, command: int, *params: float) -> Any:
        """Send a command, again if need be as QGroundControl does; its acknowledgement."""
        message = mavlink.MAVLink_command_long_message(*CAMERA, command, 0, *[*params, *([0.0] * 7)][:7])
        for _ in range(3):
            self.sock.sendto(message.pack(mavlink.MAVLink(None, *self.source)), self.peer)
            try:
                return self.hear(lambda m: m.get_type() == "COMMAND_ACK" and m.command == command, 3.0)
            except AssertionError:
                continue
        raise AssertionError(f"{command} was not acknowledged")


@pytest.fixture
def station(ports: Ports) -> Iterator[Station]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", ports.pymavlink))
        station = Station(sock)
        station.hear(lambda m: m.get_type() == "HEARTBEAT", 60.0)
        yield station


def test_the_camera_tells_a_station_behind_mavproxy_what_it_is(station: Station) -> None:
    ack = station.order(REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION)
    assert (ack.result, ack.target_system, ack.target_component) == (ACCEPTED, *STATION)
    assert any(m.get_type() == "CAMERA_INFORMATION" for m in station.heard)


def test_its_orders_are_its_own_and_so_are_the_answers(station: Station) -> None:
    ack = station.order(USER_1)
    assert (ack.result, ack.target_system, ack.target_component) == (TEMPORARILY_REJECTED, *STATION)
    station.hear(lambda m: m.get_type() == "STATUSTEXT" and "refused: the vehicle is not armed" in m.text)
    ack = station.order(USER_3)  # looks for people without flying
    assert (ack.result, ack.target_system, ack.target_component) == (ACCEPTED, *STATION)


def test_a_stranger_behind_mavproxy_stays_a_stranger(station: Station) -> None:
    station.source = (77, 190)
    ack = station.order(USER_3)
    assert (ack.result, ack.target_system, ack.target_component) == (DENIED, 77, 190)


def test_mavsdks_camera_client_discovers_it_and_its_box_is_answered(ports: Ports) -> None:
    mavsdk = Mavsdk(Configuration.create_manual(245, 190, True))
    mavsdk.add_any_connection(f"udpin://127.0.0.1:{ports.mavsdk}")
    deadline = time.monotonic() + 30.0
    while not (systems := mavsdk.get_systems()) and time.monotonic() < deadline:
        time.sleep(0.02)  # looks again until the deadline
    camera = client.Camera(systems[0])
    try:
        while not camera.camera_list().cameras and time.monotonic() < deadline:
            time.sleep(0.02)  # looks again until the deadline
        (found,) = camera.camera_list().cameras
        assert (found.vendor_name, found.component_id) == ("Sidestep", 100)
        with pytest.raises(client.CameraError) as refused:  # it is on the ground
            camera.track_rectangle(found.component_id, 0.25, 0.25, 0.5, 0.75)
        assert refused.value.result in (client.CameraResult.DENIED, client.CameraResult.BUSY)
    finally:
        camera.destroy()
        mavsdk.destroy()
