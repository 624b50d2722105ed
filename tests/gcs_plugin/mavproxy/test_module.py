"""The MAVProxy module in a real `mavproxy.py`, connected to the simulated vehicle; a stand-in answers its orders."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_plugin.geotags.log import GeotagLog
from sitl.autopilot import AutopilotConfig, start_autopilot
from sitl.autopilot.process import AutopilotProcess
from tests.support.mavproxy_process import MavProxy, environment
from tests.support.sample import geotag, origin

pytest.importorskip("MAVProxy", reason="MAVProxy is not installed (pip install .[mavproxy])")

STAND_IN = [sys.executable, "-m", "tests.support.stand_in_serve"]
MODULE = "gcs_plugin.mavproxy"


@pytest.fixture(scope="module")
def autopilot() -> Iterator[AutopilotProcess]:
    process = start_autopilot(AutopilotConfig(noise="none"))
    yield process
    process.stop()


@pytest.fixture(scope="module")
def station(autopilot: AutopilotProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[MavProxy]:
    folder = tmp_path_factory.mktemp("station")
    (folder / "sidestep.toml").write_text('[answer]\nfolder = "flights"\n', encoding="utf-8")
    proxy = MavProxy(autopilot.operator_url, folder)
    try:
        proxy.expect("online system 1")
        yield proxy
    finally:
        proxy.close()


@pytest.fixture
def loaded(station: MavProxy) -> MavProxy:
    """The station with the module, which is left loaded for the next test."""
    state = station.answer("locate status", "Unknown command|sidestep serve: [a-z]+ ")[0]
    if "Unknown" in state:
        load(station)
    elif "not" in state:
        station.answer("locate start", "sidestep serve started")
    station.retry("locate status", r"component 1:100 heard")
    return station


def load(proxy: MavProxy, **more: object) -> int:
    """Load the module with the stand-in; returns the stand-in's process id."""
    values = {"settings": "sidestep.toml", "program": " ".join(STAND_IN), **more}
    text = json.dumps(values, separators=(",", ":")).replace(" ", r"\u0020")  # MAVProxy would cut it there
    proxy.type(f"module load {MODULE}:{text}")
    started = proxy.expect(r"sidestep serve started \(process (\d+)\)")
    proxy.expect("Loaded module")
    return int(started[1])


def order_in_the_air(proxy: MavProxy, line: str, answer: str = "locate: accepted, in progress") -> None:
    """Arm, and give an order, until the news that the vehicle is armed has reached the one who carries it out.

    (On the ground it is disarmed again after ten seconds.)
    """
    until = time.monotonic() + 30.0
    while True:
        proxy.type("arm throttle force")
        proxy.type(line)
        try:
            proxy.expect(answer, 1.0)
        except AssertionError:
            if time.monotonic() > until:
                raise
        else:
            return


def ended(pid: int) -> bool:
    """Whether a process is gone, or only waits to be taken note of."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state == "Z"


def wait_until_ended(pid: int, timeout_s: float = 30.0) -> None:
    until = time.monotonic() + timeout_s
    while not ended(pid):
        assert time.monotonic() < until, f"process {pid} is still there"
        time.sleep(0.02)


def test_an_order_on_the_ground_is_refused_and_the_reason_is_shown(loaded: MavProxy) -> None:
    loaded.answer("locate", "locate: refused")
    loaded.expect("sidestep: refused: the aircraft is not armed and airborne, so there is nothing to fly")


def test_a_box_in_pixels_is_located_and_the_answer_is_shown_logged_and_exported(loaded: MavProxy) -> None:
    order_in_the_air(loaded, "locate box 64,48,128,240", r"sidestep: asked for 0\.100 0\.100 0\.300 0\.600")
    loaded.expect("locate: accepted, in progress")
    number = loaded.expect(r"target (\d+): 37\.\d+ 126\.\d+ CE90 \d\.\d m")[1]
    loaded.expect("locate: done")
    loaded.answer("locate status", rf"target {number}: 37\.\d{{7}} 126\.\d{{7}}")
    loaded.answer("locate list", rf" {number}  2026-11-22 12:00:06Z  37\.\d{{7}} 126\.\d{{7}}  CE90 \d\.\d m  0\.6 m/s")
    file = Path(loaded.answer("locate export out.kml", r"\d+ geotags written to (\S+)")[1])
    assert "<kml" in file.read_text(encoding="utf-8")


def test_a_flight_in_progress_can_be_asked_for_and_aborted_but_not_ordered_twice(loaded: MavProxy) -> None:
    order_in_the_air(loaded, "locate point 0.5,0.5")
    loaded.retry("locate status", "order: locate 50 %", 2.0)
    loaded.answer("locate", r"locate: locate runs already \(50 %\)")
    loaded.answer("locate abort", "locate: aborted")
    loaded.expect("abort: done")
    loaded.answer("locate status", "order: none")


def test_the_parameters_of_serve_are_read_and_set_and_its_limits_are_told(loaded: MavProxy) -> None:
    loaded.answer("locate set LIMITS_SPEED 4", "LIMITS_SPEED = 4\n")
    loaded.answer("locate set limits_speed 40", "LIMITS_SPEED stays 5: 40 was not taken")
    loaded.answer("locate set NO_SUCH_NAME", "NO_SUCH_NAME: not answered")
    loaded.answer("locate set targets 3", "")
    loaded.answer("locate set", r"targets 3\n")


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        ("locate box 1,2,3", "'1,2,3' is not 4 numbers"),
        ("locate box 0.1,0.1,0,0.2", "the box has no area"),
        ("locate box 10,10,nan,5", "is not 4 numbers"),
        ("locate point 900,10", r"outside the picture \(640 x 480 pixels\)"),
        ("locate point 0.5,-0.1", "outside the picture"),
        ("locate sideways", "does not know 'sideways'"),
        ("locate export targets.doc", r"no format ends in '\.doc'"),
        ("locate export", "no file is named"),
        ("locate set LIMITS_SPEED fast", "'fast' is no number"),
        ("locate set ; locate set x.y 1", "'X.Y' is no parameter name"),
        ("locate start", "runs already"),
    ],
)
def test_what_cannot_be_meant_is_explained_and_sends_nothing(loaded: MavProxy, typed: str, told: str) -> None:
    loaded.answer(typed, told)
    loaded.answer("locate status", "order: none")


def test_the_operator_points_the_camera_at_a_target_of_the_log(loaded: MavProxy, autopilot: AutopilotProcess) -> None:
    tag = geotag(f"tag-{time.time_ns()}", at=origin("amsl"))
    number = GeotagLog(loaded.folder / "flights" / "geotags.gpkg").append(tag).geotag.number
    loaded.answer(f"locate roi {number}", f"region of interest: target {number}")
    loaded.expect("DO_SET_ROI_LOCATION: ACCEPTED")
    assert autopilot.state()["roi_enu_m"] == pytest.approx([0.1, 9.0, 0.9], abs=0.1)
    loaded.answer("locate roi 9999", "there is no target 9999")


def test_orders_are_signed_where_the_station_signs(loaded: MavProxy) -> None:
    loaded.answer("locate next", "sidestep: next, unsigned")
    loaded.answer("signing key correct-horse", "Setup signing key")
    loaded.answer("locate next", "sidestep: next, signed")
    loaded.answer("signing disable", "Disabled signing")
    loaded.answer("locate next", "sidestep: next, unsigned")


@pytest.mark.parametrize("line", ["locate stop", f"module unload {MODULE}"])
def test_a_serve_that_ends_in_flight_can_still_tell_the_autopilot(
    loaded: MavProxy, autopilot: AutopilotProcess, line: str
) -> None:
    order_in_the_air(loaded, "locate")
    loaded.answer("locate status", r"process (\d+)")
    loaded.answer(line, "DO_SET_ROI_LOCATION: ACCEPTED")
    loaded.expect("sidestep serve ended|Unloaded module")
    assert autopilot.state()["roi_enu_m"] == pytest.approx([0.0, 10.0, -30.0], abs=0.5)
    loaded.answer("output list", r"(?<!\d)0 outputs")


def test_unload_and_reload_leave_nothing_behind(station: MavProxy) -> None:
    station.answer(f"module unload {MODULE}", "Unloaded module|Unable to find module")
    number = GeotagLog(station.folder / "flights" / "geotags.gpkg").append(geotag("on the map")).geotag.number
    station.answer("module load tests.support.fake_map", "Loaded module")
    before = station.threads(), station.files(), station.children()
    for reloaded in (False, True):
        pids = [load(station)]
        station.retry("locate status", "component 1:100 heard")
        station.retry("fakemap", rf"Sidestep {number}: SlipIcon {number}\n")
        station.expect(rf"Sidestep {number} ellipse 0: SlipPolygon \d\d")
        if reloaded:
            station.answer(f"module reload {MODULE}", "Unloaded module")
            pids.append(int(station.expect(r"serve started \(process (\d+)\)")[1]))
            station.expect("Reloaded module")
        station.answer("output list", "1 outputs")
        station.answer(f"module unload {MODULE}", "Unloaded module")
        station.answer("fakemap", r"(?<!\d)0 objects on the map")
        station.answer("output list", "(?<!\\d)0 outputs")
        station.answer("locate", "Unknown command 'locate'")
        assert all(ended(pid) for pid in pids)
        deadline = time.monotonic() + 10.0  # threads end after the word that the module is unloaded
        while (left := (station.threads(), station.files(), station.children())) != before:
            assert time.monotonic() < deadline, f"{left} instead of {before}"
            time.sleep(0.05)
    station.answer("module unload map", "Unloaded module")


def test_a_serve_that_ends_by_itself_is_told_with_its_last_words_and_can_be_started_again(loaded: MavProxy) -> None:
    pid = int(loaded.answer("locate status", r"running \(process (\d+)\)")[1])
    os.kill(pid, signal.SIGKILL)
    loaded.expect(r"sidestep serve ended \(exit code -9\): no message")
    loaded.answer("locate", "sidestep serve does not run. Type `locate start`")
    loaded.answer("output list", "(?<!\\d)0 outputs")
    loaded.answer("locate start", r"sidestep serve started")
    loaded.retry("locate status", "component 1:100 heard")


def test_a_wrong_command_line_is_told(loaded: MavProxy) -> None:
    program = loaded.answer("locate set program", r"program (.+)\n")[1]
    loaded.answer("locate stop", "sidestep serve ended")
    loaded.answer("locate set program /nowhere/sidestep", "")
    loaded.answer("locate start", "'/nowhere/sidestep' cannot be started: .*No such file")
    loaded.answer(f'locate set program "{sys.executable} -c 1/0"', "")
    loaded.answer("locate start", "ended .exit code 1.: ZeroDivisionError: division by zero")
    loaded.type(f'locate set program "{program}"')
    loaded.answer("locate start", "sidestep serve started")


def test_attached_to_a_serve_beside_the_vehicle(autopilot: AutopilotProcess, tmp_path: Path) -> None:
    serve = subprocess.Popen(
        [*STAND_IN, "serve", "--link", autopilot.url],
        stdin=subprocess.PIPE,
        cwd=tmp_path,
        env=environment(),
    )
    proxy = MavProxy(autopilot.operator_url, tmp_path)
    try:
        proxy.expect("online system 1")
        proxy.answer(f'module load {MODULE}:{{"attach":true}}', "Loaded module")
        proxy.retry("locate status", "sidestep serve: attached, component 1:100 heard")
        order_in_the_air(proxy, "locate point 0.25,0.75", r"sidestep: asked for 0\.250 0\.750 0\.000 0\.000")
        proxy.expect("locate: accepted, in progress")
        proxy.answer("locate abort", "locate: aborted")
        proxy.answer("locate start", "attached to a sidestep serve that runs elsewhere")
        proxy.answer("locate list", "the log of a sidestep serve elsewhere is not known")
        proxy.answer("output list", r"(?<!\d)0 outputs")
    finally:
        proxy.close()
        serve.kill()
        serve.communicate()


def test_a_station_that_is_killed_takes_its_serve_with_it(autopilot: AutopilotProcess, tmp_path: Path) -> None:
    (tmp_path / "sidestep.toml").touch()
    proxy = MavProxy(autopilot.operator_url, tmp_path)
    try:
        proxy.expect("online system 1")
        pid = load(proxy)
        proxy.retry("locate status", "component 1:100 heard")
        proxy.process.kill()
        wait_until_ended(pid)
    finally:
        proxy.close()


def test_a_station_that_ends_takes_its_serve_with_it(autopilot: AutopilotProcess, tmp_path: Path) -> None:
    (tmp_path / "sidestep.toml").touch()
    proxy = MavProxy(autopilot.operator_url, tmp_path)
    try:
        proxy.expect("online system 1")
        pid = load(proxy)
    finally:
        proxy.close()
    assert ended(pid)
    assert "Unloading module gcs_plugin.mavproxy" in proxy.text
