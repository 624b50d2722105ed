from pathlib import Path

import typer
from typer.testing import CliRunner

from gcs_plugin.cli.settings import register
from mission.settings import MissionSettings, read_settings


def printed() -> str:
    app = typer.Typer()
    register(app)
    result = CliRunner().invoke(app, [])
    assert result.exit_code == 0
    return result.stdout


def test_the_printed_file_reads_back_as_the_defaults(tmp_path: Path) -> None:
    path = tmp_path / "sidestep.toml"
    path.write_text(printed(), encoding="utf-8")
    settings = read_settings(path)
    assert settings.pattern == MissionSettings().pattern
    assert settings.limits == MissionSettings().limits


def test_every_setting_is_printed() -> None:
    text = printed()
    for section in MissionSettings.model_fields:
        assert section in text
    assert "length_m = 3.0  # how far to the side; with accuracy_percent at most; above 0.2, at most 50.0" in text
    assert "out-and-back | s | paper" in text
