"""Campaigns past people as they walk: flights are what the options say, figures are pooled."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from mission.records import NoiseModel
from sitl.evaluation.accuracy.cli import register
from sitl.evaluation.accuracy.rows import CLOSEST_M
from sitl.evaluation.people.flights import POOR, Geometry, PeopleSetting, checked_walks, people_flight
from sitl.evaluation.people.verdicts import Verdict, judged, people_table, refusals


def run(*arguments: str) -> Result:
    app = typer.Typer()
    register(app)
    return CliRunner().invoke(app, list(arguments), env={"COLUMNS": "180"})


def test_a_flight_is_its_number_and_its_seed() -> None:
    one, two = (people_flight(PeopleSetting(), 5, 3) for _ in range(2))
    assert one.flight.sightings == two.flight.sightings
    assert one.flight.sightings != people_flight(PeopleSetting(), 5, 4).flight.sightings


@pytest.mark.parametrize("geometry", [*POOR, "s", "down"])
def test_every_path_keeps_away_from_the_target_and_sees_it(geometry: Geometry) -> None:
    for number in range(6):
        sim = people_flight(PeopleSetting(geometry=(geometry,)), 2, number)
        assert np.linalg.norm(sim.target_m - sim.camera_m, axis=1).min() > CLOSEST_M
        assert len(sim.flight.sightings) == len(sim.target_m)
    if geometry == "down":
        below = sim.camera_m[0, 2] - sim.target_m[0, 2]
        assert 10.0 <= below <= 60.0
        assert 29.0 < math.degrees(math.atan2(below, sim.depth_m)) < 81.0


def test_a_crouching_person_is_lower_and_shorter_in_the_picture() -> None:
    sim = people_flight(PeopleSetting("crouching", height_m=1.8), 1, 0)
    assert np.ptp(sim.target_m[:, 2]) > 0.1
    heights = np.array([s.height_px or 0.0 for s in sim.flight.sightings])
    ranges = np.linalg.norm(sim.target_m - sim.camera_m, axis=1)
    lowest = int(np.argmin(sim.target_m[:, 2]))
    assert heights[lowest] * ranges[lowest] < 0.85 * heights[0] * ranges[0]


def test_the_header_is_not_told_what_noise_is_made() -> None:
    quiet, loud = (people_flight(PeopleSetting("straight", noise_scale=s), 1, 0) for s in (1e-6, 4.0))
    assert quiet.flight.noise == loud.flight.noise == NoiseModel()
    for sim, within in ((quiet, True), (loud, False)):
        reported = np.array([s.position_enu_m for s in sim.flight.sightings])
        assert bool(np.abs(reported - sim.camera_m).max() < 1e-4) is within


def test_wide_noise_lies_both_ways_and_turns_the_compass() -> None:
    flights = [people_flight(PeopleSetting(wide=True), 1, k).flight for k in range(30)]
    claimed = np.array([f.noise.position_sigma_m for f in flights]) / NoiseModel().position_sigma_m
    assert claimed.min() < 0.7
    assert claimed.max() > 1.4


def test_a_wrong_height_is_stated() -> None:
    stated = [people_flight(PeopleSetting(height_prior="wrong", height_m=1.7), 1, k).flight.prior for k in range(12)]
    heights = np.array([p.height_m for p in stated])
    assert heights.min() < 1.5
    assert heights.max() > 1.9


@pytest.mark.parametrize("name", ["walk", "random-walk", "random-walk:-1", "random-walk:nan", "random-walk:fast", ""])
def test_walks_that_there_are_not_are_refused(name: str) -> None:
    with pytest.raises(ValueError):
        checked_walks(name)


def test_figures_of_two_processes_are_those_of_one() -> None:
    setting = PeopleSetting("calm")
    assert list(judged(setting, 3, 1, processes=2)) == list(judged(setting, 3, 1, processes=1))


def test_reasons_are_counted_without_their_numbers() -> None:
    found = [Verdict(k, "s, calm", 5.0, f"depth uncertain by {k} %", None, None, None, "") for k in range(3)]
    assert refusals(found) == ["3 refused: depth uncertain by # %"]
    assert people_table(found, "x").row_count == 1


def test_the_command_prints_figures_and_writes_flights(tmp_path: Path) -> None:
    table = tmp_path / "flights.csv"
    options = ["--walks", "real-like", "--flights", "4", "--processes", "1", "--output", str(table)]
    result = run("--suite", *options)
    assert result.exit_code == 0, result.output
    assert "NEES mean" in result.output
    with table.open(encoding="utf-8", newline="") as stream:
        assert len(list(csv.DictReader(stream))) == 4


def test_another_method_is_judged_on_the_same_flights() -> None:
    setting = PeopleSetting("turns")
    batch, straight = (list(judged(setting, 2, 1, processes=1, method=m)) for m in ("batch", "constant-velocity"))
    assert [v.depth_m for v in batch] == [v.depth_m for v in straight]
    assert all(a.squared != b.squared for a, b in zip(batch, straight, strict=True))


def test_the_command_says_which_method_it_judged() -> None:
    options = ["--walks", "calm", "--flights", "2", "--processes", "1", "--method", "constant-velocity"]
    result = run("--suite", *options)
    assert result.exit_code == 0, result.output
    assert "constant-velocity; walks calm" in result.output


@pytest.mark.parametrize(
    "options",
    [
        ["--walks", "real-like"],
        ["--suite", "--walks", "strolling"],
        ["--suite", "--walks", "calm", "--geometry", "circle"],
        ["--suite", "--walks", "calm", "--height-prior", "tall"],
        ["--suite", "--walks", "calm", "--noise", "wide", "--noise-scale", "2"],
        ["--suite", "--walks", "calm", "--noise", "rough"],
        ["--suite", "--walks", "calm", "--noise", "wild"],
        ["--suite", "--walks", "calm", "--pattern", "S"],
        ["--suite", "--walks", "calm", "--row", "parallel:9"],
        ["--suite", "--walks", "calm", "--closed-loop"],
        ["--suite", "--walks", "calm", "--scene", "night"],
        ["--suite", "--walks", "calm", "--method", "batch", "--method", "classical"],
        ["--suite", "--walks", "random-walk:fast"],
        ["--suite", "--noise-scale", "2"],
        ["--rendered", "1", "--walks", "turns", "--geometry", "one-way"],
        ["--geometry", "poor"],
    ],
)
def test_what_cannot_be_flown_is_refused_before_it_is(options: list[str]) -> None:
    assert run(*options).exit_code == 2
