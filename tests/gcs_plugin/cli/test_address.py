"""A video's address on the command line or from standard input."""

from __future__ import annotations

import io

import pytest

from gcs_plugin.cli.address import given_address
from mission.errors import SettingsError


def test_an_address_is_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert given_address("udp://127.0.0.1:5600") == "udp://127.0.0.1:5600"
    assert capsys.readouterr().err == ""


def test_a_password_among_the_arguments_is_told_but_not_repeated(capsys: pytest.CaptureFixture[str]) -> None:
    assert given_address("rtsp://a:s3cr3t@camera/1") == "rtsp://a:s3cr3t@camera/1"
    said = capsys.readouterr().err
    assert "list of processes" in said
    assert "s3cr3t" not in said


def test_a_dash_reads_a_line_of_standard_input_for_each(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("rtsp://a:b@camera/1\nrtsp://a:b@camera/2\n"))
    assert [given_address("-"), given_address("-")] == ["rtsp://a:b@camera/1", "rtsp://a:b@camera/2"]
    with pytest.raises(SettingsError, match="no address"):
        given_address("-")
