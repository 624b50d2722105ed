"""`sidestep plan`: what it prints, and with which exit status."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from gcs_plugin.cli.app import COMMANDS
from gcs_plugin.cli.plan import register
from mission.camera import Camera, write_camera
from mission.errors import FlightRefused, SettingsError, SidestepError
from mission.settings import PatternSettings


@dataclass(frozen=True)
class Ran:
    exit_code: int
    stdout: str


def run(*arguments: object) -> Ran:
    app = typer.Typer()
    register(app)
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if isinstance(result.exception, SidestepError):
        raise result.exception  # which the `sidestep` command turns into a message
    return Ran(result.exit_code, result.stdout)


def pattern(result: Ran) -> PatternSettings:
    """The settings at the end of what was printed, as the settings file takes them."""
    return PatternSettings.model_validate(tomllib.loads(result.stdout[result.stdout.index("[pattern]") :])["pattern"])


def test_it_is_a_command_of_sidestep() -> None:
    assert "plan" in COMMANDS


def test_the_plan_is_printed_with_settings_to_paste() -> None:
    result = run("--distance-m", 9, "--sigma-m", 0.3, "--room-m", 6, "--rate-hz", 10)
    assert result.exit_code == 0
    for word in ("first to the left", "1-sigma, standing", "1-sigma, worst walk", "%", "not calibrated"):
        assert word in result.stdout
    assert 1.0 <= pattern(result).length_m <= 6.0


def test_percent_of_the_distance_is_the_same_as_metres() -> None:
    metres = run("--distance-m", 10, "--sigma-m", 0.4, "--rate-hz", 10)
    percent = run("--distance-m", 10, "--sigma-percent", 4, "--rate-hz", 10)
    assert metres.stdout == percent.stdout


def test_what_cannot_be_had_is_status_3_and_the_best_that_can_is_printed() -> None:
    result = run("--distance-m", 9, "--sigma-m", 0.15, "--room-m", 3, "--max-time-s", 8, "--rate-hz", 10)
    assert result.exit_code == 3
    assert "cannot be had; the best that can" in result.stdout
    assert "go nearer" in result.stdout or "a distance of" in result.stdout
    assert pattern(result).length_m <= 3.0


def test_the_side_with_room_is_used() -> None:
    result = run("--distance-m", 9, "--sigma-m", 0.5, "--room-m", 5, "--room-left-m", 0, "--rate-hz", 10)
    assert pattern(result).side == "right"


def test_a_calibrated_camera_needs_a_shorter_flight(tmp_path: Path) -> None:
    calibrated = Camera.from_field_of_view(640, 480, 1.22)
    path = tmp_path / "camera.toml"
    write_camera(path, Camera(calibrated.intrinsics, calibrated.mounting, calibrated=True))
    arguments = ("--distance-m", 9, "--sigma-m", 0.3, "--rate-hz", 10)
    known, unknown = run(*arguments, "--camera", path), run(*arguments)
    assert "not calibrated" not in known.stdout
    assert pattern(known).leg_duration_s < pattern(unknown).leg_duration_s


def test_the_limits_of_the_settings_hold(tmp_path: Path) -> None:
    path = tmp_path / "sidestep.toml"
    path.write_text("[limits]\nradius_m = 2.0\nmax_speed_m_s = 1.0\n", encoding="utf-8")
    found = pattern(run("--distance-m", 9, "--sigma-m", 0.5, "--settings", path, "--rate-hz", 10))
    assert found.length_m <= 2.0
    assert 1.875 * found.length_m / found.leg_duration_s <= 1.0


def test_a_flight_without_room_is_refused() -> None:
    with pytest.raises(FlightRefused, match="room to the side"):
        run("--distance-m", 9, "--sigma-m", 0.3, "--room-m", 0.5)


@pytest.mark.parametrize("wanted", [(), ("--sigma-m", 0.3, "--sigma-percent", 3)])
def test_one_way_of_saying_the_accuracy_is_needed(wanted: tuple[object, ...]) -> None:
    with pytest.raises(SettingsError, match="wanted accuracy"):
        run("--distance-m", 9, *wanted)
