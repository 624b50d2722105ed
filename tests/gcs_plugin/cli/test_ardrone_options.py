"""The AR.Drone on the command line: its address, its own video, and the baseline table in the settings."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from gcs_plugin.cli.calibrate import calibrate
from gcs_plugin.cli.calibrate_baseline import settings_text
from gcs_plugin.cli.locate import _with_options
from mission.calibration.baseline import baseline_table
from mission.errors import SettingsError
from mission.planning.pattern import PAPER_BASELINE_M, lateral_path
from mission.settings import MissionSettings, read_settings

ARDRONE = "ardrone://192.168.1.1"


def test_an_ardrone_brings_its_own_video() -> None:
    chosen = _with_options(MissionSettings(), ARDRONE, None, None)
    assert (chosen.link.url, chosen.video.url) == (ARDRONE, ARDRONE)


def test_another_video_can_be_told() -> None:
    chosen = _with_options(MissionSettings(), ARDRONE, "udp://127.0.0.1:5600", None)
    assert chosen.video.url == "udp://127.0.0.1:5600"
    chosen = _with_options(MissionSettings(), "udpin://0.0.0.0:14540", None, None)
    assert chosen.video.url == MissionSettings().video.url


def test_the_table_is_written_so_that_the_pattern_flies_it(tmp_path: Path) -> None:
    measured = 1.1 * np.cumsum(PAPER_BASELINE_M)
    table = baseline_table([measured, 1.02 * measured, 0.98 * measured])
    file = tmp_path / "baseline.toml"
    file.write_text(settings_text(table), encoding="utf-8")
    pattern = read_settings(file).pattern
    assert pattern.kind == "paper"
    path = lateral_path(pattern, 0.0)
    tenth = path.knots[10]
    assert tenth.t_s == 5.0
    assert tenth.offset_enu_m[0] == pytest.approx(-1.1 * sum(PAPER_BASELINE_M), abs=0.01)
    assert tomllib.loads(settings_text(table))["pattern"]["baseline_m"][0] == 0.0


def test_the_paper_stands_without_a_table() -> None:
    pattern = MissionSettings().pattern.model_copy(update={"kind": "paper"})
    assert lateral_path(pattern, 0.0).knots[10].offset_enu_m[0] == pytest.approx(-sum(PAPER_BASELINE_M))


@pytest.mark.parametrize("wrong", [["--side", "up"], []])
def test_baseline_says_what_is_missing_before_it_connects(wrong: list[str], tmp_path: Path) -> None:
    given = ["--drone", "udpin://127.0.0.1:1", "--camera", "none.toml", "--marker-mm", "200", "--spacing-mm", "500"]
    result = CliRunner().invoke(calibrate, ["baseline", *given, "-o", str(tmp_path / "b.toml"), *wrong])
    assert isinstance(result.exception, SettingsError)
