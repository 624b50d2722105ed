"""The rows through camera and detector: what is flown, how a flight is judged, and that the programme goes on."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from mission.errors import AnswerError
from mission.estimate.sightings_file import write_flight
from sitl.evaluation.accuracy import cli
from sitl.evaluation.accuracy.closed_loop import ClosedLoop, FlownRow, flight_name, flown, judged, row_scenario
from sitl.evaluation.accuracy.flights import SimulatedFlight, Walk, out_and_back, simulate
from sitl.evaluation.accuracy.flown_log import COLUMNS, FlownLog
from sitl.evaluation.accuracy.programme import BOUND, MethodOutcome, outcome
from sitl.evaluation.accuracy.rows import ROWS, Row
from sitl.simulation.run import Result
from sitl.simulation.score import Score

SETTING = ClosedLoop()
PARALLEL = next(row for row in ROWS if row.motion == "parallel" and row.depth_m == 9.0)
STANDING = next(row for row in ROWS if row.motion == "stationary" and row.depth_m == 5.5)


def simulated() -> SimulatedFlight:
    return simulate(out_and_back(), Walk(9.0, (-0.6, 0.0, 0.0)), np.random.default_rng(3))


def written(folder: Path, sim: SimulatedFlight) -> Path:
    """The folder of a flight, as `sidestep locate` and the simulator leave it."""
    folder.mkdir(parents=True)
    write_flight(folder / "sightings.jsonl", sim.flight)
    times = np.linspace(sim.flight.sightings[0].t_s, sim.flight.sightings[-1].t_s, 60)
    truth = [np.interp(times, [s.t_s for s in sim.flight.sightings], sim.target_m[:, axis]) for axis in range(3)]
    rows = np.column_stack([times, *truth])
    np.savetxt(folder / "truth.csv", rows, delimiter=",", header="t_s,east_m,north_m,up_m", comments="", fmt="%.4f")
    return folder


def result_of(score: Score | None, error: str = "") -> Result:
    return Result("a", 1, "good", error, 0, score, None, {}, "flights/one")


SCORE = Score(9.0, 9.0, 0.0, 0.1, 1.0, 0.0, 0.0, 1.0, True, 0.1, 0.0, (0.0, 9.0, 1.0), (0.0, 0.0, 0.0))


def flown_row(number: int, errors: tuple[float | None, float | None], row: Row = PARALLEL) -> FlownRow:
    outcomes = (
        MethodOutcome("batch", errors[0], None if errors[0] is None else True),
        MethodOutcome(BOUND, errors[1], None),
    )
    return FlownRow(row, number, SETTING, 9.1, "", outcomes)


def test_a_row_becomes_its_scenario() -> None:
    scenario = row_scenario(PARALLEL, 1, SETTING)
    (person,) = scenario.people
    assert person.distance_m == 9.0
    assert person.speed_m_s == pytest.approx(0.6)
    assert person.walk_from_line_of_sight_deg == pytest.approx(270.0)  # to the left, with the flight
    assert person.when == "drone-moves"
    away = (person.bearing_deg - scenario.vehicle.heading_deg + 180.0) % 360.0 - 180.0
    assert 3.0 <= abs(away) <= 9.0
    (still,) = row_scenario(STANDING, 1, SETTING).people
    assert still.speed_m_s == 0.0
    assert still.when is None


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.motion} {row.depth_m:g} m")
def test_every_row_walks_as_its_velocity_says(row: Row) -> None:
    scenario = row_scenario(row, 2, SETTING)
    (person,) = scenario.people
    angle = math.radians(person.walk_from_line_of_sight_deg or 0.0)
    walked = (person.speed_m_s * math.sin(angle), person.speed_m_s * math.cos(angle))
    assert walked == pytest.approx(row.velocity_m_s, abs=1e-9)


def test_flights_of_a_row_differ_and_are_the_same_again() -> None:
    first, second = row_scenario(PARALLEL, 1, SETTING), row_scenario(PARALLEL, 2, SETTING)
    assert first == row_scenario(PARALLEL, 1, SETTING)
    assert first.seed != second.seed
    assert first.vehicle != second.vehicle
    assert first != row_scenario(PARALLEL, 1, replace(SETTING, seed=2))


def test_all_flights_have_names_of_their_own() -> None:
    names = {flight_name(row, number) for row in ROWS for number in (1, 2)}
    assert len(names) == 2 * len(ROWS)


def test_a_flown_flight_is_judged_as_a_simulated_one(tmp_path: Path) -> None:
    sim = simulated()
    folder = written(tmp_path / "flights" / "one", sim)
    again = flown(folder)
    assert again.flight == sim.flight
    np.testing.assert_allclose(again.target_m, sim.target_m, atol=2e-4)
    found = judged(PARALLEL, 1, SETTING, result_of(SCORE), tmp_path, ["bearing-angle", "batch"])
    assert [one.method for one in found.outcomes] == ["bearing-angle", "batch", BOUND]
    # The reported path stands for the true one: centimetres of 9 m.
    for one in found.outcomes[:2]:
        direct = outcome(one.method, sim).error_percent
        assert direct is not None
        assert one.error_percent == pytest.approx(direct, abs=0.6)
    assert found.depth_m == pytest.approx(sim.depth_m, abs=0.05)
    bound = outcome(BOUND, sim).error_percent
    assert found.outcomes[-1].error_percent == pytest.approx(bound, rel=0.05)


def test_a_flight_without_an_answer_counts_against_every_method(tmp_path: Path) -> None:
    found = judged(PARALLEL, 1, SETTING, result_of(None, "nobody there"), tmp_path, ["batch"])
    assert found.depth_m is None
    assert found.error == "nobody there"
    assert found.outcomes == (MethodOutcome("batch", None, None), MethodOutcome(BOUND, None, None))


def test_a_flight_whose_files_are_spoilt_does_not_end_the_programme(tmp_path: Path) -> None:
    folder = written(tmp_path / "flights" / "one", simulated())
    for name in ("truth.csv", "sightings.jsonl"):
        (folder / name).write_text("")
        found = judged(PARALLEL, 1, SETTING, result_of(SCORE), tmp_path, ["batch"])
        assert name in found.error
        assert found.outcomes[0] == MethodOutcome("batch", None, None)


@pytest.mark.parametrize("spoil", ["", "t_s\n", "t_s\n1,2\n3,4\n", "t_s\n1,0,9,1\n1,0,9,1\n", "t_s\na,b,c,d\n"])
def test_a_truth_that_cannot_be_used_is_refused(tmp_path: Path, spoil: str) -> None:
    folder = written(tmp_path / "one", simulated())
    (folder / "truth.csv").write_text(spoil)
    with pytest.raises(AnswerError, match=r"truth\.csv"):
        flown(folder)


def test_the_log_remembers_whole_flights(tmp_path: Path) -> None:
    log = FlownLog(tmp_path / "flights.csv", SETTING)
    assert log.flown() == {}
    log.add(flown_row(1, (3.0, 2.0)))
    log.add(flown_row(2, (-5.0, 2.0)))
    log.add(flown_row(3, (None, None)))
    assert set(log.flown()) == {(PARALLEL, 1), (PARALLEL, 2), (PARALLEL, 3)}
    batch, bound = log.figures()
    assert (batch.median_percent, batch.answered, batch.flights, batch.inside_percent) == (4.0, 2, 3, 100.0)
    assert bound.median_percent == pytest.approx(0.6745 * 2.0)


def test_another_setting_s_flights_are_not_mixed_in(tmp_path: Path) -> None:
    FlownLog(tmp_path / "flights.csv", SETTING).add(flown_row(1, (3.0, 2.0)))
    for other in (ClosedLoop("S"), ClosedLoop(noise="rough"), ClosedLoop(seed=2)):
        assert FlownLog(tmp_path / "flights.csv", other).flown() == {}


@pytest.mark.parametrize("cut", [1, 20, 70, 95])
def test_what_a_crash_cut_off_is_flown_again_and_spoils_nothing(tmp_path: Path, cut: int) -> None:
    log = FlownLog(tmp_path / "flights.csv", SETTING)
    log.add(flown_row(1, (3.0, 2.0)))
    log.add(flown_row(2, (-5.0, 2.0)))
    content = log.path.read_bytes()
    log.path.write_bytes(content[:-cut])
    assert set(log.flown()) <= {(PARALLEL, 1), (PARALLEL, 2)}
    assert (PARALLEL, 1) in log.flown()
    log.add(flown_row(3, (1.0, 2.0)))
    assert {(PARALLEL, 1), (PARALLEL, 3)} <= set(log.flown())


def test_another_table_is_not_taken_for_the_log(tmp_path: Path) -> None:
    path = tmp_path / "flights.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(AnswerError, match="not this programme's log"):
        FlownLog(path, SETTING).flown()


def test_lines_that_make_no_sense_are_passed_over(tmp_path: Path) -> None:
    log = FlownLog(tmp_path / "flights.csv", SETTING)
    log.add(flown_row(1, (3.0, 2.0)))
    with log.path.open("a") as stream:
        stream.write("out-and-back,good,1,parallel,9,two,9.1,batch,3.0,1,\n")
        stream.write("out-and-back,good,1,flying,9,2,9.1,batch,3.0,1,\n")
        stream.write(",".join(["x"] * len(COLUMNS)) + "\n")
    assert set(log.flown()) == {(PARALLEL, 1)}


def run(*arguments: str) -> tuple[int, str]:
    app = typer.Typer()
    app.callback()(lambda: None)
    cli.register(app)
    result = CliRunner().invoke(app, ["accuracy", *arguments])
    return result.exit_code, result.output


def test_the_command_flies_what_is_missing_and_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, int]] = []

    def pretend(row: Row, number: int, setting: ClosedLoop, report: Path, *, methods: list[str]) -> FlownRow:
        asked.append((row.motion, number))
        if asked == [("stationary", 1), ("parallel", 1), ("stationary", 2)]:
            raise KeyboardInterrupt  # Ctrl-C in the third flight
        return flown_row(number, (4.0, 2.0), row)

    monkeypatch.setattr(cli, "fly_row", pretend)
    wanted = ["--closed-loop", "--repeats", "2", "--row", "parallel:9", "--row", "stationary:5.5"]
    wanted += ["--report", str(tmp_path / "r"), "--output", str(tmp_path / "out.csv")]
    assert run(*wanted)[0] != 0
    assert not (tmp_path / "out.csv").exists()
    status, output = run(*wanted)
    assert status == 0, output
    assert sorted(asked[3:]) == [("parallel", 2), ("stationary", 2)]
    assert "2 flights of" in output
    assert "4.0" in output
    assert (tmp_path / "out.csv").read_text().count("\n") == 1 + 2 * 2
    asked.clear()
    assert run(*wanted)[0] == 0
    assert asked == []


@pytest.mark.parametrize("arguments", [("--row", "flying:9"), ("--closed-loop", "--noise", "none")])
def test_wrong_options_are_refused_before_anything_flies(arguments: tuple[str, ...]) -> None:
    assert run(*arguments)[0] == 2
