"""The accuracy programme and the simulated flights that it stands on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from mission.records import NoiseModel, TargetPrior
from sitl.accuracy.cli import register
from sitl.accuracy.flights import Walk, gauss_markov, out_and_back, paper_pattern, simulate
from sitl.accuracy.programme import ROWS, accuracy, write_csv


def test_a_gauss_markov_process_has_its_sigma_and_its_correlation() -> None:
    t = np.arange(0.0, 4000.0, 0.1)
    process = gauss_markov(t, 0.3, np.random.default_rng(0))
    assert process.std() == pytest.approx(1.0, rel=0.03)
    assert np.mean(process[1:] * process[:-1]) == pytest.approx(np.exp(-1.0 / 3.0), abs=0.02)


def test_without_noise_the_sightings_are_the_geometry() -> None:
    silent = NoiseModel(*(0.0,) * 12)
    sim = simulate(
        paper_pattern(), Walk(20.0, (0.3, 0.0, 0.0)), np.random.default_rng(0), noise=silent, heading_rad=0.0
    )
    last = sim.flight.sightings[-1]
    np.testing.assert_allclose(last.position_enu_m, [-9.38, 0.0, 1.5], atol=1e-9)
    # Picture coordinates turn with the roll; their distance from the axis does not.
    off_axis = np.hypot(last.pixel[0] - 320.0, last.pixel[1] - 240.0)
    assert off_axis == pytest.approx(516.5 * np.hypot(9.38 + 1.5, 0.6) / 20.0)
    assert last.height_px == pytest.approx(516.5 * 1.75 / 20.0)


def test_a_wandering_target_wanders_as_told() -> None:
    rng = np.random.default_rng(0)
    prior = TargetPrior(acceleration_psd_m2_s3=0.005)
    speeds = [simulate(out_and_back(rate_hz=2.0), Walk(9.0), rng, prior=prior).velocity_m_s[-1, 0] for _ in range(400)]
    assert np.std(speeds) == pytest.approx(np.sqrt(0.005 * 6.0), rel=0.12)


def test_the_batch_is_at_the_bound_and_the_wrong_assumption_is_not() -> None:
    rows = [row for row in ROWS if row.motion == "parallel" and row.depth_m == 9.0]
    found = {f.method: f for f in accuracy("out-and-back", 40, 3, rows=rows)}
    assert found["batch"].median_percent < 1.7 * found["bound"].median_percent
    assert found["stereo"].median_percent > 5.0 * found["batch"].median_percent
    assert found["batch"].inside_percent is not None
    assert found["batch"].answered == 40


def test_the_programme_has_the_papers_twelve_rows_and_twelve_more() -> None:
    assert len(ROWS) == 24
    assert sum(row.published_percent is not None for row in ROWS) == 12
    assert max(row.depth_m for row in ROWS) > 11.0


def test_figures_are_written_as_csv(tmp_path: Path) -> None:
    figures = list(accuracy("paper", 2, 1, rows=ROWS[:1], methods=["batch", "stereo"]))
    write_csv(tmp_path / "figures.csv", figures)
    lines = (tmp_path / "figures.csv").read_text().splitlines()
    assert len(lines) == 4
    assert lines[1].startswith("stationary,2.75,batch,")


def test_the_command_prints_every_row(tmp_path: Path) -> None:
    app = typer.Typer()
    register(app)
    output = tmp_path / "figures.csv"
    result = CliRunner().invoke(app, ["--flights", "1", "--output", str(output)], env={"COLUMNS": "160"})
    assert result.exit_code == 0
    assert "diagonal, away" in result.stdout
    assert output.exists()
    assert CliRunner().invoke(app, ["--pattern", "spiral"]).exit_code == 2


def test_the_same_seed_flies_the_same_flights() -> None:
    one, two = (simulate(out_and_back(), Walk(9.0), np.random.default_rng(4)).flight for _ in range(2))
    assert one == two
    assert replace(one, id="other") != two
