"""The table of rendered flights on the disk, and what is read off it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import typer
from rich.console import Console

from mission.errors import AnswerError
from sitl.evaluation.rendered.campaign import TABLE, WAYS, Campaign
from sitl.evaluation.rendered.case import drawn_cases
from sitl.evaluation.rendered.command import FIGURE, run_rendered
from sitl.evaluation.rendered.report import summarise, table, write_figure
from sitl.evaluation.rendered.result_row import ResultRow, append, read

ONE = ResultRow(
    number=0,
    seed=77,
    noise="good",
    scene="street",
    distance_m=5.5,
    walk_deg=math.nan,
    speed_m_s=0.0,
    poses="reported",
    tracked_share=1.0,
    depth_error=-0.02,
    position_error_m=0.2,
    across_error_m=0.1,
    along_error_m=0.17,
    sigma_m=0.15,
    nees=1.5,
    heading_error_deg=0.3,
    tilt_error_deg=0.1,
    offset_error_ms=2.0,
)


def test_what_was_written_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "flights.csv"
    refused = replace(ONE, number=1, depth_error=math.nan, said='No distance, "none"\nat all')
    append(path, [ONE])
    append(path, [refused])
    first, second = read(path)
    assert first.depth_error == ONE.depth_error
    assert math.isnan(first.walk_deg)
    assert first.answered
    assert not second.answered
    assert second.said == refused.said


def test_a_table_that_is_not_there_is_empty(tmp_path: Path) -> None:
    assert read(tmp_path / "flights.csv") == []


def test_a_last_line_that_a_crash_cut_off_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "flights.csv"
    append(path, [ONE, replace(ONE, number=1)])
    whole = path.read_text()
    path.write_text(whole[: whole.rindex("street")])
    assert [o.number for o in read(path)] == [0]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [("number,seed", "what,ever", "not a table"), ("5.5", "far", "line 2"), (",street,", ",", "line 2")],
)
def test_a_table_that_is_none_is_refused(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = tmp_path / "flights.csv"
    append(path, [ONE, replace(ONE, number=1)])
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(AnswerError, match=says):
        read(path)


def test_a_folder_of_another_run_is_refused(tmp_path: Path) -> None:
    append(tmp_path / TABLE, [replace(ONE, poses=way) for way in WAYS])
    with pytest.raises(AnswerError, match="another run"):
        list(Campaign(tmp_path).run(list(drawn_cases(1, seed=1))))


def test_flights_that_are_there_are_not_flown_again(tmp_path: Path) -> None:
    cases = list(drawn_cases(1, seed=1))
    append(tmp_path / TABLE, [replace(ONE, seed=cases[0].seed, poses=way) for way in WAYS])
    campaign = Campaign(tmp_path)
    assert list(campaign.run(cases)) == []
    assert {o.number for o in campaign.outcomes} == {0}


def test_a_flight_that_was_not_written_whole_is_flown_again(tmp_path: Path) -> None:
    append(tmp_path / TABLE, [replace(ONE, poses=way) for way in WAYS] + [replace(ONE, number=1)])
    assert {o.number for o in Campaign(tmp_path).outcomes} == {0}
    assert {o.number for o in read(tmp_path / TABLE)} == {0}


def test_the_command_refuses_what_it_does_not_know(tmp_path: Path) -> None:
    with pytest.raises(typer.BadParameter, match="street, featureless"):
        run_rendered(Console(), 1, 1, "good", "moon", tmp_path)
    with pytest.raises(typer.BadParameter, match="good, rough"):
        run_rendered(Console(), 1, 1, "excellent", "street", tmp_path)


def test_the_command_shows_the_flights_that_are_there(tmp_path: Path) -> None:
    case = next(iter(drawn_cases(1, seed=1)))
    append(tmp_path / TABLE, [replace(ONE, seed=case.seed, poses=way) for way in WAYS])
    console = Console(width=120, record=True)
    assert len(run_rendered(console, 1, 1, "good", "street", tmp_path)) == len(WAYS)
    assert "1 rendered flights, good autopilot, street, walks straight, seed 1" in console.export_text()
    assert (tmp_path / FIGURE).exists()


def test_the_summary_counts_what_was_answered() -> None:
    outcomes = [
        replace(ONE, number=k, depth_error=error, nees=nees)
        for k, (error, nees) in enumerate([(0.01, 1.0), (-0.03, 2.0), (0.20, 9.0)])
    ]
    summary = summarise([*outcomes, replace(ONE, number=3, depth_error=math.nan)], "reported")
    assert summary is not None
    assert (summary.flights, summary.answered) == (4, 3)
    assert summary.median_percent == pytest.approx(3.0)
    assert summary.worst_percent == pytest.approx(20.0)
    assert summary.inside_percent == pytest.approx(200.0 / 3.0)
    assert summary.nees == pytest.approx(4.0)
    assert summary.heading_deg == pytest.approx(0.3)
    assert math.isnan(summary.steady_ms)
    assert summarise(outcomes, "steadied") is None


def test_the_table_and_the_figure_show_both_ways(tmp_path: Path) -> None:
    outcomes = [replace(ONE, number=k, poses=way, nees=k) for k in range(3) for way in ("reported", "steadied")]
    summaries = [summarise(outcomes, "reported"), summarise(outcomes, "steadied")]
    console = Console(width=120, record=True)
    console.print(table([s for s in summaries if s is not None], "three flights"))
    shown = console.export_text()
    assert "reported" in shown
    assert "steadied" in shown
    assert "2.0 +- 0.0" in shown
    path = tmp_path / "flights.png"
    write_figure(path, outcomes, "three flights")
    assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ValueError, match="no answered"):
        write_figure(path, [], "none")
