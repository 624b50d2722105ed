"""A scenario with an AR.Drone: its files, its camera behind the video port, and the truth beside it."""

from __future__ import annotations

import socket
import struct
import tomllib
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest

from mission.camera import read_camera
from sitl.ardrone import ArdroneProcess, config_of
from sitl.scenario.schema import Scenario, parse_scenario, read_scenario
from sitl.simulation.processes import camera_of, simulation
from tests.sitl.ardrone.test_server import Wire
from tests.support.live_ardrone import until

SCENARIO = """
name = "ardrone-small"
seed = 5
scenery = false
[autopilot]
noise = "rough"
wind_m_s = 2.0
wind_from_deg = 270.0
[vehicle]
kind = "ardrone"
heading_deg = 30.0
[ardrone]
gps = true
declination_deg = 3.0
video = "360p"
scaled_to_px = [640, 480]
wifi = { loss = 0.05 }
[camera]
width_px = 320
height_px = 180
fx = 258.25
fy = 258.25
cx = 161.0
cy = 89.0
renderings = 1
fps = 10.0
[[people]]
distance_m = 5.0
bearing_deg = 30.0
"""


@pytest.fixture
def scenario() -> Scenario:
    return parse_scenario(SCENARIO)


def test_the_aircraft_is_what_the_scenario_says(scenario: Scenario) -> None:
    config = config_of(scenario)
    assert config.noise == "rough"
    assert config.gps
    assert config.declination_rad == pytest.approx(0.05236, abs=1e-5)
    assert config.heading_rad == pytest.approx(0.5236, abs=1e-4)
    assert config.wind.mean_enu_m_s[0] == pytest.approx(2.0)
    assert config.home == scenario.home.origin


def test_the_camera_file_describes_the_scaled_picture(scenario: Scenario) -> None:
    lens = camera_of(scenario).intrinsics
    assert (lens.width_px, lens.height_px) == (640, 480)
    assert (lens.fx, lens.cx) == pytest.approx((516.5, 322.0))
    assert (lens.fy, lens.cy) == pytest.approx((688.667, 237.333), abs=1e-3)


def test_the_fault_scenario_has_a_bad_wifi() -> None:
    folder = Path(__file__).parents[3] / "sitl" / "scenarios" / "ardrone-faults"
    wifi = read_scenario(folder / "bad-wifi.toml").ardrone.wifi
    assert wifi.loss == 0.2
    assert wifi.duplicate > 0.0
    assert wifi.reorder > 0.0


@pytest.mark.flight
def test_a_simulation_has_settings_truth_video_and_navdata_on_one_clock(scenario: Scenario, tmp_path: Path) -> None:
    with simulation(scenario, tmp_path) as running:
        drone = running.autopilot
        assert isinstance(drone, ArdroneProcess)
        url = urlsplit(tomllib.loads((tmp_path / "sidestep.toml").read_text())["link"]["url"])
        query = {name: value[0] for name, value in parse_qs(url.query).items()}
        assert (url.scheme, query["codec"], query["size"], query["declination"]) == (
            *("ardrone", "360p", "640x480"),
            "3",
        )
        assert int(query["at"]) != drone.ports.at  # the bad radio stands between
        assert read_camera(tmp_path / "camera.toml").intrinsics == camera_of(scenario).intrinsics

        with Wire(drone.ports) as wire, socket.create_connection(("127.0.0.1", int(query["video"])), 5.0) as video:
            wire.wake()
            wire.send("CONFIG", '"general:navdata_demo","FALSE"')
            header = video.makefile("rb").read(64)
            assert header[:4] == b"PaVE"
            assert struct.unpack_from("<HH", header, 16) == (640, 360)
            stamp_s = struct.unpack_from("<I", header, 24)[0] / 1000.0
            packet = wire.navdata.recv(4096)
            assert until(lambda: wire.newest()[1] > 500)
            packet = wire.navdata.recv(4096)
            assert struct.unpack_from("<H", packet, 16 + 148) == (1,)
            word = struct.unpack_from("<I", packet, 16 + 148 + 4)[0]
            assert (word >> 21) + (word & 0x1FFFFF) * 1e-6 - stamp_s == pytest.approx(0.0, abs=3.0)

        newest = running.ring.newest()
        assert newest is not None
        assert newest.position_enu_m[2] == pytest.approx(0.0, abs=0.01)
        assert running.ring.mark(1) is not None
        assert running.camera.stats().frames > 0
        running.camera.fault("freeze")
        assert drone.alive
    assert not drone.alive
