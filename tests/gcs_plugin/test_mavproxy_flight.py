"""The whole of it: a real MAVProxy, the real `sidestep serve`, and a simulated aircraft with a camera."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sitl.autopilot.process import AutopilotProcess
from sitl.scenario import Scenario, read_scenario
from sitl.simulation import simulation
from tests.gcs_plugin.mavproxy_process import ROOT, MavProxy

pytest.importorskip("MAVProxy", reason="MAVProxy is not installed (pip install .[mavproxy])")


def scenario() -> Scenario:
    content = read_scenario(ROOT / "sitl" / "scenarios" / "demo.toml").model_dump()
    content["autopilot"]["flavour"] = "ardupilot"  # the one that MAVProxy's own commands fly
    return Scenario.model_validate(content)


@pytest.mark.soak
@pytest.mark.flight
def test_an_operator_takes_off_and_locates_a_person_with_mavproxy_alone(tmp_path: Path) -> None:
    with simulation(scenario(), tmp_path) as running:
        assert isinstance(running.autopilot, AutopilotProcess)
        proxy = MavProxy(running.autopilot.operator_url, tmp_path)
        try:
            proxy.expect("online system 1", 30.0)
            proxy.answer('module load gcs_plugin.mavproxy:{"settings":"sidestep.toml"}', "sidestep serve started")
            proxy.expect("sidestep serve is ready", 60.0)
            proxy.answer("locate", "locate: refused")
            proxy.expect("sidestep: refused: the vehicle is not armed and airborne")

            proxy.answer("mode guided", "Mode GUIDED")
            proxy.retry("arm throttle", "COMPONENT_ARM_DISARM: ACCEPTED", 20.0)
            proxy.answer("takeoff 2", "NAV_TAKEOFF: ACCEPTED")
            proxy.retry("status GLOBAL_POSITION_INT", r"relative_alt : (1[5-9]|2\d)\d\d,", 30.0)
            proxy.retry("locate", "locate: accepted, in progress", 20.0)
            proxy.expect("sidestep: taking control")
            number = proxy.expect(r"target (\d+): 47\.\d+ 8\.\d+ CE90 \d+\.\d m", 60.0)[1]
            proxy.expect("locate: done", 30.0)
            proxy.answer("locate list", rf" {number}  .*  47\.\d{{7}} 8\.\d{{7}}  CE90 ")
            proxy.answer("locate export targets.geojson", "1 geotags written to")
        finally:
            proxy.close()
    target, ellipse = json.loads((tmp_path / "targets.geojson").read_text(encoding="utf-8"))["features"]
    assert target["properties"]["ce90_m"] < 20.0
    assert ellipse["geometry"]["type"] == "Polygon"
