import numpy as np
import pytest

from mission.procedure.reposition import LONGEST_M, NEAREST_M, follow_path
from mission.records import Estimate


def estimate(east: float, north: float, velocity: tuple[float, float] = (0.0, 0.0), depth_m: float = 6.0) -> Estimate:
    return Estimate(
        "f",
        "batch",
        "constant-velocity",
        10.0,
        np.array([east, north, 0.9]),
        np.array([*velocity, 0.0]),
        np.eye(6),
        None,
        depth_m,
        100,
        0,
        1.0,
        1,
    )


HERE = np.array([0.0, 0.0, 1.6])


def test_a_target_that_stayed_needs_no_move() -> None:
    assert follow_path(estimate(0.0, 6.0), HERE, 10.5) is None


def test_a_target_that_went_away_is_followed_to_the_old_distance() -> None:
    path = follow_path(estimate(0.0, 9.0), HERE, 10.0)
    assert path is not None
    assert path.knots[-1].offset_enu_m == pytest.approx((0.0, 3.0, 0.0))


def test_the_targets_motion_since_then_is_foreseen() -> None:
    path = follow_path(estimate(0.0, 9.0, (0.0, 1.0)), HERE, 12.0)
    assert path is not None
    assert path.knots[-1].offset_enu_m[1] == pytest.approx(5.0)


def test_a_target_that_comes_near_is_given_room() -> None:
    path = follow_path(estimate(0.0, 1.0, depth_m=2.0), HERE, 10.0)
    assert path is not None
    assert path.knots[-1].offset_enu_m[1] == pytest.approx(1.0 - NEAREST_M)


def test_no_move_is_longer_than_the_limit_and_it_ends_at_rest() -> None:
    path = follow_path(estimate(40.0, 0.0), HERE, 10.0)
    assert path is not None
    assert path.knots[-1].offset_enu_m[0] == pytest.approx(LONGEST_M)
    assert path.knots[-1].velocity_enu_m_s == pytest.approx((0.0, 0.0, 0.0))
