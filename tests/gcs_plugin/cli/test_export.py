"""`sidestep export`."""

from __future__ import annotations

import json
import os
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from gcs_plugin.cli.export import register
from gcs_plugin.geotags.log import GeotagLog
from mission.errors import SettingsError
from tests.support.sample import geotag


@pytest.fixture
def app() -> typer.Typer:
    app = typer.Typer()
    app.callback()(lambda: None)  # with a single command typer would leave its name out
    register(app)
    return app


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.gpkg"
    GeotagLog(path).append(geotag())
    return path


@pytest.mark.parametrize(
    ("name", "start"), [("geojson", '{"type": "FeatureCollection"'), ("kml", "<?xml "), ("csv", "number,id,time_utc")]
)
def test_every_format_goes_to_standard_output_or_to_a_file(
    app: typer.Typer, log: Path, tmp_path: Path, name: str, start: str
) -> None:
    shown = CliRunner().invoke(app, ["export", str(log), "--format", name])
    assert shown.exit_code == 0
    assert shown.stdout.startswith(start)
    file = tmp_path / "out"
    assert CliRunner().invoke(app, ["export", str(log), "--format", name, "--output", str(file)]).exit_code == 0
    assert file.read_bytes().decode() == shown.stdout_bytes.decode()


def test_the_exported_geotag_is_the_one_in_the_log(app: typer.Typer, log: Path) -> None:
    shown = CliRunner().invoke(app, ["export", str(log), "--format", "geojson"])
    assert json.loads(shown.stdout)["features"][0]["properties"]["id"] == "tag-1"


def test_a_log_that_is_not_there_and_one_of_another_kind_are_argument_errors(app: typer.Typer, tmp_path: Path) -> None:
    missing = CliRunner().invoke(app, ["export", str(tmp_path / "none.gpkg"), "--format", "csv"])
    assert isinstance(missing.exception, SettingsError)
    other = tmp_path / "other.gpkg"
    other.write_bytes(b"something else " * 100)
    assert isinstance(CliRunner().invoke(app, ["export", str(other), "--format", "csv"]).exception, SettingsError)


def test_an_unknown_format_is_refused_with_the_choices(app: typer.Typer, log: Path) -> None:
    result = CliRunner().invoke(app, ["export", str(log), "--format", "shape"])
    assert result.exit_code == 2
    assert "geojson" in result.output


@pytest.mark.parametrize("name", ["geojson", "kml", "csv"])
def test_a_terminal_that_knows_only_ascii_gets_utf8_all_the_same(tmp_path: Path, name: str) -> None:
    path = tmp_path / "log.gpkg"
    GeotagLog(path).append(replace(geotag(), notes=("Größe, 位置",)))
    run = subprocess.run(
        [sys.executable, "-m", "gcs_plugin", "export", str(path), "--format", name],
        env={**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "Größe" in run.stdout.decode("utf-8")


def test_a_row_that_is_no_geotag_is_told_beside_the_export(app: typer.Typer, log: Path) -> None:
    GeotagLog(log).append(geotag("b"))
    with sqlite3.connect(log) as connection:
        connection.execute("UPDATE geotags SET lat_deg = 'north' WHERE fid = 1")
    connection.close()
    shown = CliRunner().invoke(app, ["export", str(log), "--format", "csv"])
    assert shown.exit_code == 0
    assert [line.split(",")[1] for line in shown.stdout.splitlines()] == ["id", "b"]
    assert "row 1 of the geotag log" in shown.stderr
