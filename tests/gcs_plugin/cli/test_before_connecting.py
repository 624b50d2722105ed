"""What is wrong with an order whatever the aircraft says is told before anything is connected."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from gcs_plugin.cli.locate import register
from mission.errors import SidestepError


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--box", "10,10,0,50"), "the box is empty"),
        (("--box", "10,10,20,nan"), "the box is empty"),
        (("--box=-30,10,20,20",), "the box lies outside the picture"),
        (("--point=-1,5",), "the point lies outside the picture"),
        (("--take-off", "0.2"), "take-off height of 0.2 m is outside 1 to 30 m"),
        (("--take-off", "nan"), "take-off height of nan m is outside"),
        (("--camera", "nowhere.toml"), "nowhere.toml"),
    ],
)
def test_it_is_said_and_nothing_is_made(options: tuple[str, ...], said: str, tmp_path: Path) -> None:
    settings = tmp_path / "sidestep.toml"
    settings.write_text('[answer]\nfolder = "flights"\n', "utf-8")
    app = typer.Typer()
    register(app)
    result = CliRunner().invoke(app, ["--settings", str(settings), "--link", "udpin://127.0.0.1:1", *options])
    assert isinstance(result.exception, SidestepError)
    assert said in str(result.exception)
    assert not (tmp_path / "flights").exists()
