import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.planning.pattern import PAPER_BASELINE_M, fitted, lateral_path, left_of
from mission.settings import PatternSettings

headings = st.floats(-math.pi, math.pi)


def test_left_of_north_is_west() -> None:
    np.testing.assert_allclose(left_of(0.0), [-1.0, 0.0, 0.0], atol=1e-12)


def test_left_of_east_is_north() -> None:
    np.testing.assert_allclose(left_of(math.pi / 2), [0.0, 1.0, 0.0], atol=1e-12)


@given(headings, st.sampled_from(["out-and-back", "s"]), st.floats(0.5, 20.0), st.integers(1, 3))
def test_default_patterns_end_where_they_began_at_rest(heading: float, kind: str, length: float, passes: int) -> None:
    path = lateral_path(PatternSettings.model_validate({"kind": kind, "length_m": length, "passes": passes}), heading)
    assert path.knots[0].offset_enu_m == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(path.knots[-1].offset_enu_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(path.knots[-1].velocity_enu_m_s, 0.0, atol=1e-9)


@given(headings, st.sampled_from(["out-and-back", "s", "paper"]))
def test_patterns_stay_on_the_line_across_the_heading(heading: float, kind: str) -> None:
    path = lateral_path(PatternSettings.model_validate({"kind": kind}), heading)
    offsets = np.array([knot.offset_enu_m for knot in path.knots])
    ahead = offsets @ np.array([math.sin(heading), math.cos(heading), 0.0])
    np.testing.assert_allclose(ahead, 0.0, atol=1e-9)


@given(st.sampled_from(["out-and-back", "s"]), st.floats(0.5, 10.0), st.floats(1.0, 10.0))
def test_knot_velocities_are_the_slopes_of_the_offsets(kind: str, length: float, duration: float) -> None:
    path = lateral_path(
        PatternSettings.model_validate({"kind": kind, "length_m": length, "leg_duration_s": duration}), 0.3
    )
    t = np.array([knot.t_s for knot in path.knots])
    x = np.array([knot.offset_enu_m for knot in path.knots])
    v = np.array([knot.velocity_enu_m_s for knot in path.knots])
    middle = np.diff(x, axis=0) / np.diff(t)[:, None]
    np.testing.assert_allclose(middle, (v[1:] + v[:-1]) / 2.0, atol=0.05 * length / duration)


def test_the_side_turns_the_pattern_round() -> None:
    left = lateral_path(PatternSettings(side="left"), 0.0)
    right = lateral_path(PatternSettings(side="right"), 0.0)
    for a, b in zip(left.knots, right.knots, strict=True):
        np.testing.assert_allclose(a.offset_enu_m, -np.array(b.offset_enu_m), atol=1e-12)


def test_the_paper_pattern_has_the_travel_of_table_ii() -> None:
    path = lateral_path(PatternSettings(kind="paper"), 0.0)
    at = {round(knot.t_s, 3): -knot.offset_enu_m[0] for knot in path.knots}
    assert at[0.5] == 0.0
    assert at[2.5] == pytest.approx(2.6625)
    assert at[5.0] == pytest.approx(sum(PAPER_BASELINE_M))
    np.testing.assert_allclose(path.knots[-1].velocity_enu_m_s, 0.0, atol=1e-12)


def test_s_goes_to_both_sides() -> None:
    path = lateral_path(PatternSettings(kind="s", length_m=2.0), 0.0)
    east = [knot.offset_enu_m[0] for knot in path.knots]
    assert min(east) == pytest.approx(-2.0)
    assert max(east) == pytest.approx(2.0)


def test_a_pattern_is_shortened_for_a_near_target_and_kept_for_a_far_one() -> None:
    assert fitted(PatternSettings(length_m=3.0), 2.0).length_m == pytest.approx(1.8)
    assert fitted(PatternSettings(length_m=3.0), 9.0).length_m == 3.0


def test_the_papers_pattern_is_never_shortened() -> None:
    assert fitted(PatternSettings(kind="paper"), 2.0) == PatternSettings(kind="paper")
