from pathlib import Path

import typer
from typer.testing import CliRunner

from gcs_plugin.cli.serve import register
from gcs_plugin.component.parameter_table import PARAMETER_NAMES
from mission.errors import SettingsError


def invoke(*arguments: str) -> tuple[int, str, BaseException | None]:
    app = typer.Typer()
    register(app)
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.stdout, result.exception


def test_the_parameters_are_printed_with_the_settings_that_they_are() -> None:
    code, said, _ = invoke("--parameters")
    assert code == 0
    for setting, name in PARAMETER_NAMES.items():
        assert any(line.split()[:2] == [name, setting] for line in said.splitlines())


def test_a_settings_file_that_is_not_there_is_told() -> None:
    _, _, error = invoke("--settings", "/no/such/file.toml")
    assert isinstance(error, SettingsError)


def test_a_signing_key_that_is_not_there_ends_it_before_anything_is_opened(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text('[authority]\nkey_file = "none"\n[answer]\nfolder = "flights"\n')
    _, _, error = invoke("--settings", str(tmp_path / "s.toml"))
    assert isinstance(error, SettingsError)
    assert "signing key" in error.cause


def test_vehicles_on_one_link_need_their_system_ids() -> None:
    _, _, error = invoke("--link", "udpin://0.0.0.0:14540", "--link", "udpin://0.0.0.0:14540")
    assert isinstance(error, SettingsError)
    assert "--system" in error.remedy
