"""`sidestep estimate`: what it prints, where, and with which exit status."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from gcs_plugin.cli.estimate import register
from mission.estimate import ESTIMATORS
from mission.estimate.sightings_file import write_flight
from sitl.evaluation.accuracy.flights import Walk, out_and_back, simulate

FIELDS = [
    "id", "method", "model", "t_s", "position_enu_m", "velocity_enu_m_s", "covariance", "lat_deg", "lon_deg", "alt_m",
    "datum", "first", "depth_m", "ce90_m", "le90_m", "sightings", "rejected", "chi2", "dof",
]  # fmt: skip


def run(*arguments: object) -> tuple[int, list[dict[str, object]], str]:
    app = typer.Typer()
    register(app)
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, [json.loads(line) for line in result.stdout.splitlines()], result.stderr


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "flights.jsonl"
    rng = np.random.default_rng(0)
    for i in range(3):
        write_flight(path, simulate(out_and_back(), Walk(9.0), rng, name=f"flight {i}").flight, append=True)
    return path


def test_every_flight_is_answered_in_order(path: Path) -> None:
    status, answers, _ = run(path)
    assert status == 0
    assert [answer["id"] for answer in answers] == ["flight 0", "flight 1", "flight 2"]
    for answer in answers:
        assert [field for field in answer if field in FIELDS] == FIELDS
        assert np.array(answer["covariance"]).shape == (6, 6)
        assert np.array(answer["first"]["covariance"]).shape == (3, 3)  # type: ignore[index]
        assert answer["depth_m"] == pytest.approx(9.0, rel=0.2)
        assert answer["lat_deg"] == pytest.approx(37.2276, abs=1e-3)
        assert answer["datum"] == "ellipsoid"


@pytest.mark.parametrize("method", sorted(ESTIMATORS))
def test_every_method_can_be_chosen_and_leaves_null_what_it_cannot_give(path: Path, method: str) -> None:
    status, answers, _ = run(path, "--method", method)
    assert status == 0
    assert {answer["method"] for answer in answers} == {method}
    assert (answers[0]["ce90_m"] is None) == (method not in ("batch", "constant-velocity"))
    assert answers[0]["depth_m"] is not None


def test_a_bad_flight_gives_an_error_line_and_status_3(path: Path) -> None:
    lines = path.read_text().splitlines()
    lines[70] = lines[70].replace('"pixel"', '"pixels"')
    path.write_text("\n".join(lines))
    status, answers, _ = run(path)
    assert status == 3
    assert [set(answer) == {"id", "error"} for answer in answers] == [False, True, False]
    assert answers[1]["id"] == "flight 1"
    assert f"{path}:71: " in str(answers[1]["error"])


def test_a_flight_that_cannot_be_answered_says_why_and_what_would_help(path: Path) -> None:
    path.write_text("\n".join(path.read_text().splitlines()[:3]))
    status, answers, _ = run(path)
    assert status == 3
    assert "too few" in str(answers[0]["error"])
    assert "Keep the target in view" in str(answers[0]["error"])


def test_the_answers_can_be_written_to_a_file(path: Path, tmp_path: Path) -> None:
    output = tmp_path / "answers.jsonl"
    status, answers, _ = run(path, "--output", output)
    assert status == 0
    assert answers == []
    assert len(output.read_text().splitlines()) == 3


def test_what_cannot_be_read_is_status_2_and_the_other_files_are_answered(path: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty.jsonl"
    empty.write_text("")
    status, answers, said = run(tmp_path / "none.jsonl", empty, path)
    assert status == 2
    assert len(answers) == 3
    assert "none.jsonl" in said
    assert "empty.jsonl" in said


def test_wrong_arguments_are_status_2(path: Path) -> None:
    assert run(path, "--method", "guess")[0] == 2
    assert run()[0] == 2
    before = path.read_text()
    assert run(path, "--output", path)[0] == 2
    assert path.read_text() == before
