"""What counts as the right person, the wrong one, and a jump."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from mission.records import Box
from mission.track import Track, TrackState
from sitl.real_video.annotations import Annotations, Walker, read
from sitl.real_video.score import followed, steadiness


def box(x: float, height: float = 80.0) -> Box:
    return Box(x - 0.2 * height, 200.0 - 0.5 * height, 0.4 * height, height)


def track(frame: int, x: float, state: TrackState = "tracking", height: float = 80.0) -> Track:
    shown = height if state == "tracking" else None
    sigma = 0.03 if state == "tracking" else None
    return Track(frame, frame / 7.0, state, box(x, height), (x, 200.0), 1.0, shown, sigma, 1.0)


def two() -> Annotations:
    """One walks to the right, the other stands at 160 px."""
    own = Walker("own", "development", {k: box(100.0 + 6.0 * k) for k in range(30)})
    other = Walker("other", "development", dict.fromkeys(range(30), box(160.0)))
    return Annotations(7.0, (own, other), ())


def test_who_is_followed_is_right_and_who_is_taken_instead_is_wrong_and_one_switch() -> None:
    known = two()
    own = known.walkers[0]
    good = followed(own, [track(k, 100.0 + 6.0 * k) for k in range(1, 30)], known)
    assert (good.right, good.wrong, good.switches) == (29, 0, 0)
    switched = followed(own, [track(k, min(100.0 + 6.0 * k, 160.0)) for k in range(1, 30)], known)
    assert switched.wrong > 10
    assert switched.switches == 1
    assert switched.right < 20


def test_what_is_not_shown_as_tracking_is_never_wrong() -> None:
    known = two()
    told = followed(known.walkers[0], [track(k, 160.0, "coasting") for k in range(20, 30)], known)
    assert (told.wrong, told.coasting, told.right) == (0, 10, 0)
    nobody = followed(known.walkers[0], [track(k, 500.0) for k in range(20, 30)], known)
    assert (nobody.wrong, nobody.nowhere) == (0, 10)


def test_a_step_that_no_person_makes_is_a_jump_and_a_walk_is_none() -> None:
    walk = [track(k, 100.0 + 14.0 * k) for k in range(30)]
    assert steadiness(walk).jumps == 0
    assert steadiness([*walk[:15], track(15, 500.0), *walk[16:]]).jumps == 2
    assert steadiness([*walk[:15], track(15, 310.0, height=120.0), *walk[16:]]).jumps >= 1
    gone = [track(k, 100.0, "coasting" if 10 <= k < 13 else "tracking") for k in range(30)]
    assert steadiness(gone).fragments == 1
    assert steadiness(gone).held == pytest.approx(0.9)


def test_the_scatter_is_that_of_what_was_put_in_whatever_the_walk() -> None:
    rng = np.random.default_rng(3)
    shaky = [track(k, 100.0 + 6.0 * k + 0.05 * k**2 + 2.0 * float(rng.normal())) for k in range(400)]
    assert steadiness(shaky).scatter == pytest.approx(2.0, rel=0.15)
    assert math.isnan(steadiness(shaky[:5]).scatter)


def test_the_annotations_are_of_people_who_walk() -> None:
    known = read()
    assert len(known.walkers) == 20
    assert {w.half for w in known.walkers} == {"development", "held-out"}
    for walker in known.walkers:
        frames = sorted(walker.boxes)
        for one, two_ in itertools.pairwise(frames):
            a, b = walker.boxes[one], walker.boxes[two_]
            step = np.hypot(*np.subtract(a.centre_px, b.centre_px)) / a.height_px
            assert step < 0.5 + 0.25 * (two_ - one), f"{walker.name}, frame {one}"
