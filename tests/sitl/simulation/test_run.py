"""Real closed loops: a simulated aircraft, `sidestep locate` as users run it, and what goes wrong in the air."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from gcs_plugin.cli.estimate import register
from gcs_plugin.geotags.log import read_geotags
from mission.geodesy import geodetic_to_enu
from sitl.autopilot import Mode
from sitl.faults import LinkFaults
from sitl.simulation.run import Result
from tests.support.airborne import PATTERN, TAKE_OFF, Airborne, airborne

pytestmark = pytest.mark.flight

SCENARIO = """
name = "closed-loop"
seed = 11
[autopilot]
wind_m_s = 0.3
[vehicle]
heading_deg = 40.0
[camera]
tilt_down_deg = 10.0
distortion = { k1 = -0.05, k2 = 0.01 }
exposure_ms = 8.0
readout_ms = 16.0
extra_latency_ms = 60.0
[[people]]
distance_m = 5.5
bearing_deg = 46.0
speed_m_s = 0.6
walk_from_line_of_sight_deg = 60.0
when = "drone-turns"
stop_after_s = 13.0
"""


@dataclass
class Flown:
    """The simulation after its first flight, still in the air."""

    aircraft: Airborne
    first: Result
    said: str


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flown]:
    """The first flight is flown over a link that loses one packet in twenty."""
    with airborne(SCENARIO, tmp_path_factory.mktemp("closed-loop"), faults=LinkFaults(loss=0.05)) as aircraft:
        aircraft.set_integer("COM_OBL_RC_ACT", 5)
        first, said = aircraft.locate(*TAKE_OFF)
        aircraft.relay.set(LinkFaults())
        yield Flown(aircraft, first, said)


def test_a_walking_person_is_located_over_a_link_that_loses_packets(flown: Flown) -> None:
    assert flown.first.score is not None, flown.said
    assert flown.first.exit_code == 0
    assert flown.first.score.depth_error_pct < 12.0
    assert flown.first.score.velocity_error_m_s < 0.35


def test_the_error_is_of_the_size_that_the_ellipse_says(flown: Flown) -> None:
    assert flown.first.score is not None
    assert flown.first.score.nees < 16.0
    assert flown.first.score.sigma_m < 1.0


def test_the_answer_is_on_the_disk_as_geotag_pictures_and_sightings(flown: Flown) -> None:
    flights = flown.aircraft.report / "flights"
    folder = flown.aircraft.report / flown.first.flight_folder
    (geotag,) = read_geotags(flights / "geotags.gpkg")[:1]
    assert geotag.picture_type == "image/jpeg"
    for name in ("plan.png", "contact-sheet.jpg", "sightings.jsonl", "events.jsonl", "answer.json", "estimate.json"):
        assert (folder / name).stat().st_size > 100, name


def test_the_autopilot_got_the_region_of_interest_and_the_waypoint(flown: Flown) -> None:
    state = flown.aircraft.autopilot.state()
    home = flown.aircraft.running.scenario.home.origin
    (geotag,) = read_geotags(flown.aircraft.report / "flights" / "geotags.gpkg")[:1]
    place = geodetic_to_enu(geotag.place.lat_deg, geotag.place.lon_deg, home.alt_m, home)
    assert np.linalg.norm(np.array(state["roi_enu_m"], dtype=float)[:2] - place[:2]) < 0.05
    assert state["mission_items"] == 1


def test_the_log_estimates_to_the_same_answer_again(flown: Flown) -> None:
    folder = flown.aircraft.report / flown.first.flight_folder
    estimate = typer.Typer()
    register(estimate)
    again = json.loads(CliRunner().invoke(estimate, [str(folder / "sightings.jsonl")]).stdout)
    assert flown.first.answer is not None
    for key in ("position_enu_m", "velocity_enu_m_s", "covariance", "depth_m"):
        assert again[key] == flown.first.answer[key]


def test_what_the_autopilot_reported_is_kept_and_scored_too(flown: Flown) -> None:
    assert flown.first.score is not None
    without = flown.first.as_reported
    assert without is not None
    assert without.depth_truth_m == pytest.approx(flown.first.score.depth_truth_m, abs=0.05)
    assert without.depth_m != flown.first.score.depth_m
    assert without.depth_error_pct < 40.0


def test_ctrl_c_in_the_pattern_holds_and_leaves_the_log_whole(flown: Flown) -> None:
    code, said = flown.aircraft.locate_until(PATTERN, lambda process: process.send_signal(signal.SIGINT))
    assert code == 1
    assert "aborted by the operator" in said
    assert flown.aircraft.comes_to_rest()
    assert flown.aircraft.autopilot.state()["mode"] == Mode.HOLD.value
    folder = flown.aircraft.newest_folder()
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    assert events[-1]["kind"] == "failed"
    assert "aborted" in json.loads((folder / "answer.json").read_text())["error"]


def test_video_that_stops_in_the_pattern_holds_and_says_so(flown: Flown) -> None:
    code, said = flown.aircraft.locate_until(PATTERN, lambda _: flown.aircraft.camera.fault("cut"))
    flown.aircraft.camera.fault("resume")
    assert code == 1
    assert "no picture for 1 s" in said
    assert flown.aircraft.comes_to_rest()
