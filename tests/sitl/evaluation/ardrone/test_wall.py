"""The calibration flight's comparison with the truth."""

from __future__ import annotations

import numpy as np
import pytest

from mission.errors import AnswerError
from mission.planning.pattern import PAPER_BASELINE_M
from sitl.evaluation.ardrone.wall import SCENARIO, compare
from sitl.scenario.schema import read_scenario

TRAVEL = np.cumsum(PAPER_BASELINE_M)
IMAGES_S = 0.5 * np.arange(11)


def flown(starts_s: list[float], scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Runs of the paper's pattern, each flown back at once."""
    times = np.arange(0.0, starts_s[-1] + 12.0, 0.02)
    along = sum(np.interp(times - start, [*IMAGES_S, 9.0], [*scale * TRAVEL, 0.0]) for start in starts_s)
    return times, np.asarray(along)


def test_each_run_is_found_in_the_truth_and_compared() -> None:
    table = compare(TRAVEL, *flown([3.0, 15.0, 27.0], 0.97), 3)
    assert table.runs == 3
    # Where the scale is wrong the best start is a little off; that must not hide the error.
    assert 0.2 < table.worst_m < 0.5


def test_a_right_table_agrees_to_the_centimetre() -> None:
    assert compare(TRAVEL, *flown([3.0, 15.0, 27.0]), 3).worst_m < 0.01


def test_a_truth_without_any_run_is_said() -> None:
    times = np.arange(0.0, 30.0, 0.02)
    with pytest.raises(AnswerError, match="looks like"):
        compare(TRAVEL, times, np.zeros(len(times)), 3)


def test_the_wall_reaches_beyond_the_pattern_and_its_stop() -> None:
    wall = read_scenario(SCENARIO).marker_wall
    assert wall is not None
    stop_m = TRAVEL[-1] + 0.75 * PAPER_BASELINE_M[-1] / 0.5
    assert wall.left_m - wall.spacing_m > stop_m - 0.6 * wall.distance_m
    assert (wall.markers - 1) * wall.spacing_m - wall.left_m > 0.6 * wall.distance_m
