"""The console's page in a browser, the program behind it and the simulated drone: tap, locate, reload, abort."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from gcs_plugin.geotags.log import read_geotags
from mission.geodesy import geodetic_to_enu
from sitl.autopilot import AutopilotProcess, Mode
from sitl.scenario.schema import read_scenario
from sitl.simulation.processes import Simulation, simulation
from tests.gcs_plugin.console.browsers import chromium, needs_chromium, page_of
from tests.support.station import Station, until

pytestmark = [pytest.mark.flight, needs_chromium]
DEMO = Path(__file__).parents[3] / "sitl" / "scenarios" / "two-people.toml"
PATIENCE_MS = 60_000


@contextmanager
def served(running: Simulation, folder: Path) -> Iterator[str]:
    """`sidestep console` on the simulation; the page's address."""
    said = folder / "console.txt"
    command = [sys.executable, "-m", "gcs_plugin", "console", "--settings", str(running.settings), "--port", "0"]
    with said.open("w") as output, subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT) as process:
        try:
            assert until(lambda: "console: http" in said.read_text(), 60.0)
            found = re.search(r"console: (\S+)", said.read_text())
            assert found is not None
            yield found[1]
        finally:
            process.terminate()
            process.wait(30.0)


def mark_somebody(page: Page) -> None:
    page.locator("#boxes button").first.wait_for(timeout=PATIENCE_MS)
    page.locator("#boxes button").first.dispatch_event("click")  # it follows whoever it frames
    expect(page.locator("#confirm")).to_be_visible()


def test_tap_locate_reload_in_mid_flight_abort_and_a_second_viewer(tmp_path: Path) -> None:
    expect.set_options(timeout=PATIENCE_MS)
    complaints: list[str] = []
    with simulation(read_scenario(DEMO), tmp_path) as running, served(running, tmp_path) as url, chromium() as browser:
        autopilot = running.autopilot
        assert isinstance(autopilot, AutopilotProcess)
        page, second = page_of(browser, url, complaints), page_of(browser, url, complaints, 390, 844)
        expect(page.locator("#sentence")).to_contain_text("on the ground")
        with Station(autopilot.operator_url) as station:
            station.take_off(1.6)
        expect(page.locator("#sentence")).to_contain_text("Ready.")
        mark_somebody(page)
        page.locator("#locate").click()
        page.locator("#steps li.now[data-stage=sidestep]").wait_for(timeout=PATIENCE_MS)
        page.reload()
        expect(second.locator("#target-list h3")).to_contain_text("Target 1")
        expect(page.locator("#target-list h3")).to_contain_text("Target 1")
        expect(page.locator("#place")).to_contain_text("CE90")
        expect(page.locator("#commander")).to_have_text("You are in command")
        (tag,) = read_geotags(tmp_path / "flights" / "geotags.gpkg")
        home = running.scenario.home.origin
        east_north = geodetic_to_enu(tag.place.lat_deg, tag.place.lon_deg, home.alt_m, home)[:2]
        assert float(np.linalg.norm(east_north)) < 30.0
        expect(page.locator("#target-list")).to_contain_text(f"{tag.place.lat_deg:.7f}")

        expect(page.locator("#sentence")).to_contain_text("Ready.")
        mark_somebody(page)
        page.keyboard.press("l")
        assert until(lambda: autopilot.state()["mode"] == Mode.OFFBOARD.value, 60.0)
        page.keyboard.press("Escape")
        assert until(lambda: autopilot.state()["mode"] != Mode.OFFBOARD.value, 15.0)
        expect(page.locator("#news")).to_contain_text("abort")
    assert complaints == []
