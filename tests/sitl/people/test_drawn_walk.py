"""Drawn walks have the statistics of recorded pedestrians (two public sets from above, 2.5 Hz; one of lidar paths)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.records import Vector
from sitl.people.drawn_walk import KINDS, DrawnWalk, WalkKind, draw_walk, random_walk

DT_S = 0.4
ANNOTATION_M = 0.045
"""What marking people in pictures adds to each of their places."""
DURATION_S = 24.0


@pytest.fixture(scope="module")
def tracks() -> list[Vector]:
    rng = np.random.default_rng(7)
    t = np.arange(0.0, DURATION_S, DT_S)
    return [
        draw_walk(rng, "any", DURATION_S).at(t).way_m + ANNOTATION_M * rng.standard_normal((len(t), 2))
        for _ in range(350)
    ]


def semivariogram(tracks: list[Vector], lag: int) -> tuple[float, float]:
    """Half the mean square change of velocity along and across, m2/s2, of people who move."""
    halves = []
    for track in tracks:
        whole = track[-1] - track[0]
        if np.linalg.norm(whole) < 0.3 * DURATION_S:
            continue
        forward = whole / np.linalg.norm(whole)
        velocity = np.diff(track, axis=0) / DT_S
        change = velocity[lag:] - velocity[:-lag]
        halves.append([np.mean((change @ axis) ** 2) / 2.0 for axis in (forward, [forward[1], -forward[0]])])
    along, across = np.mean(halves, axis=0)
    return float(along), float(across)


def deviations(tracks: list[Vector], window_s: float) -> Vector:
    """Largest distance per axis from the best line at constant velocity, in windows."""
    count = round(window_s / DT_S) + 1
    design = np.column_stack((np.ones(count), np.arange(count)))
    found = []
    for track in tracks:
        for start in range(0, len(track) - count, count):
            part = track[start : start + count]
            found.extend(np.abs(part - design @ np.linalg.lstsq(design, part, rcond=None)[0]).max(axis=0))
    return np.array(found)


@pytest.mark.parametrize(
    ("lag_s", "least", "most"),
    [
        (0.4, 0.019, 0.07),
        (1.2, 0.02, 0.07),
        (2.0, 0.026, 0.09),
        (3.2, 0.035, 0.1),
        (4.8, 0.05, 0.12),
        (7.6, 0.06, 0.15),
    ],
)
def test_velocity_changes_as_much_as_recorded(tracks: list[Vector], lag_s: float, least: float, most: float) -> None:
    for value in semivariogram(tracks, round(lag_s / DT_S)):
        assert least < value < most


@pytest.mark.parametrize(
    ("window_s", "quantiles"),
    [
        (3.0, [(0.09, 0.12), (0.14, 0.25), (0.18, 0.32)]),
        (6.0, [(0.19, 0.25), (0.34, 0.60), (0.45, 0.70)]),
        (10.0, [(0.22, 0.52), (0.5, 1.2), (0.9, 1.4)]),
    ],
)
def test_nobody_keeps_a_straight_line(
    tracks: list[Vector], window_s: float, quantiles: list[tuple[float, float]]
) -> None:
    found = np.percentile(deviations(tracks, window_s), [50.0, 90.0, 95.0])
    for value, (least, most) in zip(found, quantiles, strict=True):
        assert least < value < most


def test_speeds_are_those_of_pedestrians(tracks: list[Vector]) -> None:
    speeds = np.concatenate([np.linalg.norm(track[5:] - track[:-5], axis=1) / (5.0 * DT_S) for track in tracks])
    slow, middle, quick = np.percentile(speeds, [5.0, 50.0, 95.0])
    assert slow < 0.45
    assert 1.3 < middle < 1.55
    assert 1.8 < quick < 2.3


@pytest.mark.parametrize("kind", KINDS)
def test_the_way_is_the_integral_of_the_velocity(kind: WalkKind) -> None:
    walk = draw_walk(np.random.default_rng(3), kind, 8.0)
    t = np.arange(0.0, 8.0, 0.01)
    motion = walk.at(t)
    np.testing.assert_allclose(motion.way_m[0], 0.0, atol=1e-9)
    integral = np.cumsum(motion.velocity_m_s, axis=0) * 0.01
    assert np.abs(integral - motion.way_m).max() < 0.1
    assert walk.kind == kind


def shares(kind: WalkKind) -> list[DrawnWalk]:
    rng = np.random.default_rng(4)
    return [draw_walk(rng, kind, 6.0) for _ in range(40)]


def test_what_is_named_is_seen() -> None:
    turned = [
        abs(math.remainder(math.atan2(*w.velocity_m_s[0]) - math.atan2(*w.velocity_m_s[-1]), 2.0 * math.pi))
        for w in shares("turns")
    ]
    assert np.median(turned) > math.radians(25.0)
    assert all(w.stature.min() < 0.9 for w in shares("crouching"))
    assert np.median([np.linalg.norm(w.velocity_m_s[0]) for w in shares("starts")]) < 0.3
    least = [np.linalg.norm(w.velocity_m_s, axis=1).min() for w in shares("stops")]
    assert np.median(least) < 0.2
    assert min(np.linalg.norm(w.velocity_m_s[0]) for w in shares("fast")) > 4.0


def test_a_random_walk_has_its_intensity() -> None:
    rng = np.random.default_rng(5)
    ends = [random_walk(rng, 0.1, 4.0).velocity_m_s for _ in range(600)]
    changes = np.array([v[-1] - v[0] for v in ends])
    assert np.mean(changes**2) == pytest.approx(0.1 * 4.02, rel=0.12)


def test_the_same_seed_gives_the_same_walk() -> None:
    one, two = (draw_walk(np.random.default_rng(6), "any", 5.0) for _ in range(2))
    np.testing.assert_array_equal(one.way_m, two.way_m)
