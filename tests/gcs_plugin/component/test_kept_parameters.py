"""What a station has set is there after a restart, until somebody changes the settings file."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority
from gcs_plugin.component import CameraComponent, Identity
from gcs_plugin.component.kept_parameters import KeptParameters
from mission.settings import MissionSettings, PatternSettings
from tests.support.component_bench import PICTURE, Bench

FILE = MissionSettings(pattern=PatternSettings(length_m=3.0))


def run(folder: Path, in_the_file: MissionSettings, **set_to: float) -> tuple[MissionSettings, list[str]]:
    """A run of the program in which a station sets parameters: what it started with, and what it said of it."""
    kept = KeptParameters(folder / "parameters.json", in_the_file)
    bench = Bench(kept.settings)
    authority = Authority(in_the_file.authority)
    component = CameraComponent(
        bench.wire, Identity(1), PICTURE, kept.settings, authority, lambda _: "", lambda: bench.now, kept.keep
    )
    bench.component = component
    component.__enter__()
    for name, number in set_to.items():
        bench.say(mavlink.MAVLink_param_set_message(1, 100, name.encode(), number, mavlink.MAV_PARAM_TYPE_REAL32))
    bench.turn()
    kept.close()
    return kept.settings, kept.restored


def test_a_set_parameter_is_there_after_a_restart_and_is_told(tmp_path: Path) -> None:
    run(tmp_path, FILE, PATTERN_LENGTH_M=4.0)
    settings, restored = run(tmp_path, FILE)
    assert settings == FILE.model_copy(update={"pattern": PatternSettings(length_m=4.0)})
    assert restored == ["PATTERN_LENGTH_M 4 instead of 3"]


def test_a_settings_file_that_was_changed_since_counts(tmp_path: Path) -> None:
    run(tmp_path, FILE, PATTERN_LENGTH_M=4.0, PRIOR_SPEED_M_S=2.5)
    changed = MissionSettings(pattern=PatternSettings(length_m=2.0))
    settings, restored = run(tmp_path, changed)
    assert settings.pattern.length_m == 2.0
    assert settings.prior.speed_sigma_m_s == 2.5
    assert len(restored) == 1


def test_set_back_to_the_settings_file_nothing_is_kept(tmp_path: Path) -> None:
    run(tmp_path, FILE, PATTERN_LENGTH_M=4.0)
    run(tmp_path, FILE, PATTERN_LENGTH_M=3.0)
    assert (tmp_path / "parameters.json").read_text() == "{}\n"


def test_a_setting_that_is_not_set_is_kept_as_such(tmp_path: Path) -> None:
    run(tmp_path, FILE, VIDEO_LATENCY_S=0.2)
    assert run(tmp_path, FILE, VIDEO_LATENCY_S=math.nan)[0].video.latency_s == pytest.approx(0.2)
    assert run(tmp_path, FILE)[0].video.latency_s is None


def test_a_value_that_the_settings_refuse_is_not_kept(tmp_path: Path) -> None:
    run(tmp_path, FILE, PATTERN_LENGTH_M=-4.0)
    assert not (tmp_path / "parameters.json").exists()


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        "[" * 100_000,
        "\xff",
        '{"PATTERN_LENGTH_M": 4}',
        '{"PATTERN_LENGTH_M": {"set": "x", "instead_of": 3}}',
        '{"PATTERN_LENGTH_M": {"set": true, "instead_of": 3}}',
        '{"PATTERN_LENGTH_M": {"set": 4}}',
        '{"PATTERN_LENGTH_M": {"set": 1' + 400 * "0" + ', "instead_of": 3}}',
        '{"PATTERN_LENGTH_M": {"set": -1' + 5000 * "0" + ', "instead_of": 3}}',
        '{"PATTERN_LENGTH_M": {"set": 1e400, "instead_of": 3}}',
        '{"PATTERN_LENGTH_M": {"set": [[3]], "instead_of": 3}}',
        '{"REPEAT": {"set": 1e300, "instead_of": 1}}',
        '{"PATTERN_KIND": {"set": -1, "instead_of": 0}}',
        '{"LIMITS_RADIUS_M": {"set": 500, "instead_of": 15}}',
    ],
)
def test_what_means_nothing_is_told_and_the_settings_file_counts(tmp_path: Path, content: str) -> None:
    (tmp_path / "parameters.json").write_text(content, "latin-1")
    kept = KeptParameters(tmp_path / "parameters.json", FILE)
    assert (kept.settings, kept.restored) == (FILE, [])
    (told,) = kept.passed_over
    assert "parameters.json" in told
    assert len(told) < 400


def test_one_bad_entry_costs_one_parameter(tmp_path: Path) -> None:
    (tmp_path / "parameters.json").write_text(
        '{"REPEAT": {"set": 1e999, "instead_of": 1}, "PATTERN_LENGTH_M": {"set": 4, "instead_of": 3}}', "ascii"
    )
    kept = KeptParameters(tmp_path / "parameters.json", FILE)
    assert kept.settings.pattern.length_m == 4.0
    assert len(kept.passed_over) == len(kept.restored) == 1


def test_a_limit_set_by_a_station_does_not_outlive_a_tighter_settings_file(tmp_path: Path) -> None:
    run(tmp_path, FILE, LIMITS_RADIUS_M=12.0)
    tighter = FILE.model_copy(update={"limits": FILE.limits.model_copy(update={"radius_m": 6.0})})
    assert run(tmp_path, tighter)[0].limits.radius_m == 6.0


def test_a_parameter_of_a_newer_version_and_a_value_out_of_range_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / "parameters.json").write_text(
        '{"NEW_THING": {"set": 1, "instead_of": 0}, "PATTERN_LENGTH_M": {"set": -1, "instead_of": 3.0}}'
    )
    kept = KeptParameters(tmp_path / "parameters.json", FILE)
    assert (kept.settings, kept.restored) == (FILE, [])


def test_the_safety_limits_of_the_file_are_a_ceiling(tmp_path: Path) -> None:
    wide = {"LIMITS_RADIUS_M": 500.0, "LIMITS_SPEED_M_S": 20.0, "LIMITS_MIN_H_M": 0.3, "LIMITS_TIME_S": 1200.0}
    run(tmp_path, FILE, **wide)
    settings, restored = run(tmp_path, FILE)
    assert settings.limits == FILE.limits
    assert restored == []
    run(tmp_path, FILE, LIMITS_RADIUS_M=5.0, LIMITS_MIN_H_M=4.0)
    settings, _ = run(tmp_path, FILE)
    assert (settings.limits.radius_m, settings.limits.min_height_m) == (5.0, 4.0)
