"""Place, velocity and height of people as the association of people has them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.track.walk import Seen, Walk

HEIGHT = 80.0
STILL = (0.0, 0.0)


def after(walk: Walk, velocity_px_s: float, looks: int, dt_s: float = 0.14, sigma_px: float = 0.0) -> Walk:
    rng = np.random.default_rng(2)
    start = walk.x_px
    for k in range(1, looks + 1):
        walk = walk.predicted(dt_s, STILL, STILL)
        x = start + velocity_px_s * k * dt_s + sigma_px * float(rng.normal())
        walk = walk.updated(Seen(x, walk.y_px, math.log(HEIGHT)))
    return walk


def test_the_velocity_of_a_walker_is_learnt_and_foretells_the_place() -> None:
    walk = after(Walk(100.0, 200.0, math.log(HEIGHT)), 60.0, 15, sigma_px=2.0)
    assert walk.u_px_s == pytest.approx(60.0, abs=10.0)
    assert walk.predicted(0.5, STILL, STILL).x_px == pytest.approx(walk.x_px + 30.0, abs=8.0)


def test_the_uncertainty_grows_while_nobody_is_seen_and_is_that_of_people_who_may_turn() -> None:
    walk = after(Walk(100.0, 200.0, math.log(HEIGHT)), 0.0, 15)
    later = [walk.predicted(t, STILL, STILL).sigma for t in (0.14, 0.5, 1.0, 2.0)]
    assert np.all(np.diff(later) > 0.0)
    # Who stands and sets off at 1.4 m/s is 0.8 body heights away after a second.
    assert 0.2 < later[2] < 0.8


def test_prediction_in_one_step_or_in_many_is_the_same() -> None:
    walk = after(Walk(100.0, 200.0, math.log(HEIGHT)), 60.0, 15)
    once = walk.predicted(0.4, (4.0, 0.0), (0.04, 0.0))
    often = walk
    for _ in range(4):
        often = often.predicted(0.1, (1.0, 0.0), (0.01, 0.0))
    assert often.x_px == pytest.approx(once.x_px, abs=1e-6)
    assert often.place_var == pytest.approx(once.place_var, rel=1e-6)
    assert often.size_var == pytest.approx(once.size_var, rel=1e-6)


def test_half_a_body_is_likelier_to_be_the_same_than_somebody_beside_it() -> None:
    walk = after(Walk(100.0, 200.0, math.log(HEIGHT)), 0.0, 15)
    whole = walk.log_likelihood(Seen(101.0, 200.0, math.log(HEIGHT)))
    half = walk.log_likelihood(Seen(101.0, 180.0, math.log(0.55 * HEIGHT)))
    beside = walk.log_likelihood(Seen(101.0 + HEIGHT, 200.0, math.log(HEIGHT)))
    assert whole > half + 3.0
    assert half > beside + 2.0


def test_who_is_cut_off_by_the_picture_tells_no_height() -> None:
    walk = Walk(100.0, 200.0, math.log(HEIGHT), size_var=0.09)
    seen = walk.updated(Seen(110.0, 200.0, None))
    assert seen.log_height == walk.log_height
    assert seen.size_var == walk.size_var
    assert 100.0 < seen.x_px < 110.0
