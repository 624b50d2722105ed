"""The accuracy programme and the simulated flights that it stands on."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner, Result

from mission.records import NoiseModel, TargetPrior
from sitl.evaluation.accuracy.cli import register
from sitl.evaluation.accuracy.flights import Walk, gauss_markov, out_and_back, paper_pattern, simulate
from sitl.evaluation.accuracy.programme import METHODS, Figures, accuracy, available_methods, solutions, write_csv
from sitl.evaluation.accuracy.rows import ROWS, detector_noise, drawn_flights, row_flights, walking_flights
from sitl.evaluation.accuracy.suite import Pooled, suite
from sitl.evaluation.accuracy.tables import accuracy_table
from sitl.evaluation.comparators import stone_soup


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


QUICK = ["classical", "stereo", "three-image", "four-image", "ground ray", "bearing-angle", "batch"]


def test_the_batch_is_at_the_bound_and_the_wrong_assumption_is_not() -> None:
    rows = [row for row in ROWS if row.motion == "parallel" and row.depth_m == 9.0]
    found = {f.method: f for f in accuracy("out-and-back", 40, 3, rows=rows, methods=QUICK)}
    assert found["batch"].median_percent < 1.7 * found["bound"].median_percent
    assert found["batch"].p95_percent < 1.7 * found["bound"].p95_percent
    assert found["stereo"].median_percent > 5.0 * found["batch"].median_percent
    assert found["batch"].inside_percent is not None
    assert found["batch"].answered == 40


def test_all_methods_of_the_programme_are_there() -> None:
    assert set(METHODS) == {*QUICK, "EKF", "UKF", "constant-velocity", "least_squares"}
    assert set(available_methods()) >= {*QUICK, "least_squares"}


def test_without_stone_soup_its_columns_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stone_soup, "installed", lambda: False)
    assert {"EKF", "UKF"}.isdisjoint(available_methods())
    result = run("--flights", "1", "--method", "EKF")
    assert result.exit_code == 2
    assert "not installed" in result.output


def test_the_slow_solver_gets_only_its_share_of_the_flights() -> None:
    told: list[int] = []
    figures = {
        f.method: f
        for f in accuracy(
            "paper",
            5,
            1,
            rows=ROWS[1:2],
            methods=["least_squares", "batch"],
            least_squares_flights=1,
            tell=lambda: told.append(1),
        )
    }
    assert figures["least_squares"].flights == 1
    assert figures["batch"].flights == 5
    assert len(told) == 6 == solutions(["least_squares", "batch"], 1, 5, 1)


def test_the_programme_has_the_papers_twelve_rows_and_twelve_more() -> None:
    assert len(ROWS) == 24
    assert [(row.depth_m, row.published_percent) for row in ROWS if row.published_percent is not None] == [
        *((2.75, 14.5), (5.5, 9.3), (7.25, 3.6), (9.0, 0.4)),
        *((4.5, 9.3), (7.6, 12.0), (5.45, 2.2), (6.9, 2.2)),
        *((2.75, 24.7), (5.5, 12.3), (7.25, 14.2), (9.0, 9.1)),
    ]
    more = [row for row in ROWS if row.published_percent is None]
    assert len(more) == 12
    assert all("diagonal" in row.motion or row.depth_m > 11.0 for row in more)


def test_nearer_people_are_measured_less_exactly_in_pixels() -> None:
    assert detector_noise(2.75).pixel_sigma_px == 2.4
    assert detector_noise(25.0).pixel_sigma_px == 1.2
    assert 1.4 < detector_noise(7.0).pixel_sigma_px < 1.8


def test_the_papers_pattern_ends_where_the_target_leaves_the_picture() -> None:
    for row in ROWS:
        for sim in row_flights(row, "paper", 3, np.random.default_rng(1)):
            assert len(sim.flight.sightings) == len(sim.target_m) >= 3
            assert all(0.0 < s.pixel[0] < 640.0 for s in sim.flight.sightings)
    assert len(row_flights(ROWS[0], "paper", 1, np.random.default_rng(1))[0].flight.sightings) < 11


def test_pooled_flights_differ_in_nothing_but_what_is_asked_for() -> None:
    clean, wrong = (list(walking_flights(("S",), 12, 5, wrong_share=share)) for share in (0.0, 0.1))
    for one, two in zip(clean, wrong, strict=True):
        np.testing.assert_array_equal(one.target_m, two.target_m)
        same = [a == b for a, b in zip(one.flight.sightings, two.flight.sightings, strict=True)]
        np.testing.assert_array_equal(same, ~two.wrong)
    assert any(sim.wrong.any() for sim in wrong)


def test_nobody_is_flown_past_too_near() -> None:
    for sim in drawn_flights(("out-and-back", "S"), 40, 3):
        assert np.hypot(*(sim.target_m - sim.camera_m)[:, :2].T).min() > 1.5


def test_figures_are_written_as_csv(tmp_path: Path) -> None:
    figures = list(accuracy("paper", 2, 1, rows=ROWS[:1], methods=["batch", "stereo"]))
    write_csv(tmp_path / "figures.csv", figures)
    lines = (tmp_path / "figures.csv").read_text().splitlines()
    assert len(lines) == 4
    assert lines[1].startswith("stationary,2.75,14.5,batch,")


def test_a_method_without_an_answer_has_a_dash_and_no_figure(tmp_path: Path) -> None:
    figures = [Figures(ROWS[0], "batch", 1.5, 3.0, 4, 4, 75.0), Figures(ROWS[0], "stereo", np.nan, np.nan, 0, 4, None)]
    write_csv(tmp_path / "figures.csv", figures)
    assert (tmp_path / "figures.csv").read_text().splitlines()[2] == "stationary,2.75,14.5,stereo,,,0,4,"
    console = Console(width=100, record=True, file=StringIO())
    console.print(accuracy_table(figures, "test", "median"))
    line = next(line for line in console.export_text().splitlines() if "stationary" in line)
    assert line.split() == ["stationary", "2.75", "14.5", "1.5", "-"]


def test_the_command_prints_every_row_and_draws_them(tmp_path: Path) -> None:
    output, picture = tmp_path / "figures.csv", tmp_path / "figures.png"
    methods = [part for name in ("stereo", "ground ray", "bearing-angle", "batch") for part in ("--method", name)]
    result = run("--flights", "2", *methods, "--output", str(output), "--figure", str(picture))
    assert result.exit_code == 0
    assert result.stdout.count("diagonal, away") == 2 * 4
    assert "x the bound" in result.stdout
    assert len(output.read_text().splitlines()) == 1 + 24 * 5
    image = cv2.imread(str(picture))
    assert image is not None
    assert min(image.shape[:2]) > 900
    assert image.std() > 10.0


def test_wrong_arguments_are_refused(tmp_path: Path) -> None:
    assert run("--pattern", "spiral").exit_code == 2
    assert run("--method", "guess").exit_code == 2
    assert run("--suite", "--output", str(tmp_path / "x.csv")).exit_code == 2
    assert run("--output", str(tmp_path / "nowhere" / "x.csv")).exit_code == 2
    assert run("--figure", str(tmp_path / "x.gif")).exit_code == 2


def test_the_suite_measures_everything_that_the_batch_is_held_to() -> None:
    held = list(suite(14, 7))
    assert len(held) == 12
    assert sum(one.reached for one in held) >= 8  # of so few flights; the command's thousand are the measure
    result = run("--suite", "--flights", "6")
    assert result.exit_code in (0, 3)
    assert "velocities from the prior" in result.stdout


def test_pooled_figures_are_those_of_their_definitions() -> None:
    pooled = Pooled(5, np.array([0.01, -0.02, 0.03, -0.04]), np.array([3.0, 4.0]), np.array([1.0, 2.0, 3.0, 7.0]), 1)
    assert pooled.refused == 1
    assert pooled.median_percent == pytest.approx(2.5)
    assert pooled.over_bound == pytest.approx(np.sqrt(12.5))
    assert pooled.inside_percent == 75.0
    assert pooled.nees == 3.25


def run(*arguments: str) -> Result:
    app = typer.Typer()
    register(app)
    return CliRunner().invoke(app, list(arguments), env={"COLUMNS": "160"})


def test_the_same_seed_flies_the_same_flights() -> None:
    one, two = (simulate(out_and_back(), Walk(9.0), np.random.default_rng(4)).flight for _ in range(2))
    assert one == two
    assert replace(one, id="other") != two
