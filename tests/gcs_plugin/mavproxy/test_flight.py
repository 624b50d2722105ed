"""A closed loop over MAVLink: a real MAVProxy, the `sidestep serve` that it starts, and a simulated ArduPilot.

One flight: refused on the ground and to a stranger, a box that becomes a target, and an abort by a second station.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from gcs_plugin.geotags.log import read_geotags
from mission.geodesy import geodetic_to_enu
from sitl.autopilot import AutopilotProcess, Mode
from sitl.scenario.schema import parse_scenario
from sitl.simulation.processes import Simulation, simulation
from sitl.simulation.run import Result, scored
from tests.sitl.simulation.test_run import SCENARIO
from tests.support.mavproxy_process import MavProxy
from tests.support.station import Station, until

pytest.importorskip("MAVProxy", reason="MAVProxy is not installed (pip install .[mavproxy])")
pytestmark = pytest.mark.flight

USER_1, USER_2, RECTANGLE = 31010, 31011, 2005
ACCEPTED, DENIED = 0, 2
BOX = (0.46, 0.22, 0.20, 0.50)
"""Left, top, width and height: around the person, when the aircraft hovers."""
PASSPHRASE = "correct-horse"
SIGNED = """
[authority]
key_file = "key"
"""
NEES_999 = float(chi2.ppf(0.999, 2))
# ArduPilot is the one that MAVProxy's own commands fly.
COPTER = SCENARIO.replace("[autopilot]", '[autopilot]\nflavour = "ardupilot"')


@dataclass
class Flown:
    """What happened, one thing after the other."""

    said: str = ""
    """By MAVProxy on its console."""
    unsigned: list[int] = field(default_factory=list)
    result: Result | None = None
    roi_error_m: float = float("inf")
    """From the geotag's place to where the autopilot looks."""
    statuses: int = 0
    answers: int = 0
    acknowledged_s: float = 0.0
    box: list[int] = field(default_factory=list)
    abort: list[int] = field(default_factory=list)
    mode_after_abort: str = ""
    texts: str = ""
    exported: list[dict[str, dict[str, object]]] = field(default_factory=list)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flown]:
    folder = tmp_path_factory.mktemp("operator")
    (folder / "key").write_bytes(hashlib.sha256(PASSPHRASE.encode()).digest())
    with simulation(parse_scenario(COPTER), folder, extra_settings=SIGNED) as running:
        assert isinstance(running.autopilot, AutopilotProcess)
        proxy = MavProxy(running.autopilot.operator_url, folder)
        try:
            yield fly(running, running.autopilot, proxy, folder)
        finally:
            proxy.close()


def fly(running: Simulation, autopilot: AutopilotProcess, proxy: MavProxy, folder: Path) -> Flown:
    found = Flown()
    key = (folder / "key").read_bytes()
    with Station(autopilot.operator_url, key) as second, Station(autopilot.operator_url, source=(254, 190)) as stranger:
        proxy.expect("online system 1", 60.0)
        proxy.answer(f"signing key {PASSPHRASE}", "Setup signing key")
        proxy.answer('module load gcs_plugin.mavproxy:{"settings":"sidestep.toml"}', "sidestep serve started")
        proxy.expect("sidestep serve is ready", 60.0)
        proxy.answer("locate", "locate: refused")
        proxy.expect("sidestep: refused: the vehicle is not armed and airborne")

        proxy.answer("mode guided", "Mode GUIDED")
        proxy.retry("arm throttle", "COMPONENT_ARM_DISARM: ACCEPTED", 30.0)
        proxy.answer("takeoff 1.6", "NAV_TAKEOFF: ACCEPTED")
        stranger.command(USER_1)
        assert until(lambda: stranger.results(USER_1), 10.0)
        found.unsigned = stranger.results(USER_1)
        proxy.retry("status GLOBAL_POSITION_INT", r"relative_alt : 1[45678]\d\d,", 60.0)

        proxy.retry(f"locate box {','.join(map(str, BOX))}", "locate: accepted, in progress", 20.0)
        proxy.expect(r"target (\d+): -?\d+\.\d+ -?\d+\.\d+ CE90 \d+\.\d m", 90.0)
        proxy.expect("locate: done", 60.0)
        proxy.answer("locate list", r" 1  .*  -?\d+\.\d{7} -?\d+\.\d{7}  CE90 ")
        proxy.answer("locate export targets.geojson", "1 geotags written to")
        found.result = scored(running, folder, 0, [])
        found.roi_error_m = roi_error_m(running, autopilot, folder)
        found.statuses = len(second.found("CAMERA_TRACKING_IMAGE_STATUS"))
        found.answers = len(second.found("CAMERA_TRACKING_GEO_STATUS"))

        left, top, width, height = BOX
        began = time.monotonic()
        second.command(RECTANGLE, left, top, left + width, top + height)
        assert until(lambda: second.results(RECTANGLE), 10.0)
        found.acknowledged_s = time.monotonic() - began
        found.box = second.results(RECTANGLE)
        assert until(lambda: autopilot.state()["mode"] == Mode.OFFBOARD.value, 30.0), second.texts()
        second.command(USER_2)
        assert until(lambda: second.results(USER_2), 10.0)
        assert until(lambda: autopilot.state()["mode"] != Mode.OFFBOARD.value, 15.0), second.texts()
        proxy.expect("aborted")
        found.abort = second.results(USER_2)
        found.mode_after_abort = str(autopilot.state()["mode"])
        found.texts, found.said = second.texts(), proxy.text
    found.exported = json.loads((folder / "targets.geojson").read_text(encoding="utf-8"))["features"]
    return found


def roi_error_m(running: Simulation, autopilot: AutopilotProcess, folder: Path) -> float:
    (geotag,) = read_geotags(folder / "flights" / "geotags.gpkg")
    home = running.scenario.home.origin
    place = geodetic_to_enu(geotag.place.lat_deg, geotag.place.lon_deg, home.alt_m, home)
    looked_at = np.array(autopilot.state()["roi_enu_m"], dtype=float)
    return float(np.linalg.norm(looked_at[:2] - place[:2]))


def test_on_the_ground_the_order_is_refused_with_the_reason(flown: Flown) -> None:
    assert "locate: refused" in flown.said


def test_an_unsigned_order_does_not_fly(flown: Flown) -> None:
    assert flown.unsigned == [DENIED]
    assert "254/190 does not sign" in flown.texts


def test_the_person_in_the_box_is_located_as_well_as_the_answer_says(flown: Flown) -> None:
    assert flown.result is not None
    assert flown.result.score is not None, flown.result.error
    assert flown.result.score.nees < NEES_999
    assert flown.result.score.sigma_m < 1.5, "an ellipse that says something"


def test_the_autopilot_looks_at_the_answer(flown: Flown) -> None:
    assert flown.roi_error_m < 0.05


def test_every_station_sees_the_box_move_and_gets_the_answer_once(flown: Flown) -> None:
    assert flown.statuses >= 10
    assert flown.answers == 1
    assert "target 1" in flown.texts


def test_the_target_is_exported_with_its_ellipse(flown: Flown) -> None:
    target, ellipse = flown.exported
    assert float(str(target["properties"]["ce90_m"])) < 20.0
    assert ellipse["geometry"]["type"] == "Polygon"


def test_another_stations_box_is_acknowledged_at_once(flown: Flown) -> None:
    assert flown.box == [ACCEPTED]
    assert flown.acknowledged_s < 0.5


def test_another_stations_abort_ends_the_flight_and_the_aircraft_holds(flown: Flown) -> None:
    assert flown.abort == [ACCEPTED]
    assert flown.mode_after_abort in ("hold", "brake")
