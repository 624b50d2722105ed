"""`sidestep draw`."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from gcs_plugin.cli.draw import register
from gcs_plugin.flight_report.flight_folder import FlightFolder
from mission.errors import SettingsError
from tests.gcs_plugin.flight_report.test_plan_view import flight
from tests.support.sample import NOON


@pytest.fixture
def app() -> typer.Typer:
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    return app


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with FlightFolder(tmp_path, NOON) as made:
        made.write_sightings([flight()])
    return made.path


@pytest.mark.parametrize(("name", "start"), [("a.png", b"\x89PNG"), ("a.PDF", b"%PDF"), ("a.svg", b"<?xml")])
def test_the_picture_is_what_its_name_says_and_the_path_is_told(
    app: typer.Typer, folder: Path, tmp_path: Path, name: str, start: bytes
) -> None:
    done = CliRunner().invoke(app, ["draw", str(folder), "--output", str(tmp_path / name)])
    assert done.exit_code == 0, done.exception
    assert (tmp_path / name).read_bytes().startswith(start)
    assert str(tmp_path / name) in done.stdout.replace("\n", "")


@pytest.mark.parametrize("name", ["plan.jpg", "plan", "plan.docx"])
def test_another_kind_of_file_is_refused_with_the_choices(
    app: typer.Typer, folder: Path, tmp_path: Path, name: str
) -> None:
    done = CliRunner().invoke(app, ["draw", str(folder), "--output", str(tmp_path / name)])
    assert isinstance(done.exception, SettingsError)
    assert ".png, .pdf, .svg" in str(done.exception)
    assert not (tmp_path / name).exists()
