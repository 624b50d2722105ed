"""`sidestep sitl`: what is wrong with its options is told before anything flies."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

import sitl
from mission.errors import SettingsError
from sitl.cli import register

DEMO = Path(sitl.__file__).parent / "scenarios" / "demo.toml"


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--noise", "awful"], "autopilot.noise"),
        (["--seed", "-4"], "seed"),
        (["--settings", "none.toml"], "none.toml"),
    ],
    ids=str,
)
def test_an_option_that_no_scenario_has_is_named(options: list[str], named: str, tmp_path: Path) -> None:
    app = typer.Typer()
    register(app)
    result = CliRunner().invoke(app, [str(DEMO), "--report", str(tmp_path / "report"), *options])
    assert isinstance(result.exception, SettingsError)
    assert named in str(result.exception)
    assert not (tmp_path / "report").exists()
