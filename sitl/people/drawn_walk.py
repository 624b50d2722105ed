"""Walks drawn at random, as people walk: nobody keeps a straight line at constant speed for six seconds.

A velocity is a preferred one plus a wander: a random walk per axis whose intensity differs from person to person (log
normal, so that a few wander much) and that is drawn back to the preferred pace over some seconds. On top come the
sway of a body over its feet and what people do now and then: turn, stop, start, weave, give way, slow down for a
greeting, crouch. The mixture `any` is held to the velocity semivariograms and to the deviations from straight lines
that were measured of recorded pedestrians (tests/sitl/people/test_drawn_walk.py); each kind alone lies inside or
beyond.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from mission.records import Vector
from sitl.gauss_markov import GaussMarkov, Wander

WalkKind = Literal[
    "calm",
    "wandering",
    "turns",
    "stops",
    "starts",
    "weaving",
    "giving-way",
    "greeting",
    "crouching",
    "standing",
    "running",
    "fast",
]
KINDS: tuple[WalkKind, ...] = get_args(WalkKind)
ANY_SHARES: Mapping[WalkKind, float] = {
    "calm": 0.52,
    "wandering": 0.25,
    "turns": 0.02,
    "stops": 0.02,
    "starts": 0.02,
    "weaving": 0.02,
    "giving-way": 0.06,
    "greeting": 0.02,
    "crouching": 0.01,
    "standing": 0.06,
}
"""How often each kind is met where nothing else is said."""

_DT_S = 0.02
_RECALL_S = 6.0
"""Over which the wander is drawn back to the preferred velocity."""
_INTENSITY_SPREAD = 0.7
"""Standard deviation of the log of a person's intensity."""
_CALM_PSD = 0.028
"""Median intensity of most people, m2/s3 per axis."""
_WANDERING_PSD = 0.036
_FACING_M_S = 0.2
_EVENT_EVERY_S = 9.0
"""Mean time between two turns, stops and so on of somebody who does such things."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A walk at given times, from where it began, in the plane's axes: right and ahead, or east and north."""

    way_m: Vector
    """(n, 2), travelled since time 0."""
    velocity_m_s: Vector
    """(n, 2)."""
    stature: Vector
    """(n,), height over the height standing: below 1 who crouches."""


@dataclass(frozen=True, slots=True, eq=False)
class DrawnWalk:
    """One person's walk; `heading_rad` of the preferred direction is clockwise from the second axis."""

    kind: WalkKind
    times_s: Vector
    way_m: Vector
    velocity_m_s: Vector
    stature: Vector
    heading_rad: Vector
    """Where the person faces; with `speed_m_s` the walk without the sway of the body."""
    speed_m_s: Vector

    def at(self, t_s: Vector) -> Motion:
        """The walk at times from 0 to its duration, shape (n,)."""

        def read(table: Vector) -> Vector:
            return np.asarray(np.interp(t_s, self.times_s, table))

        return Motion(
            np.column_stack([read(self.way_m[:, k]) for k in (0, 1)]),
            np.column_stack([read(self.velocity_m_s[:, k]) for k in (0, 1)]),
            read(self.stature),
        )


def draw_walk(
    rng: np.random.Generator,
    kind: WalkKind | Literal["any"] = "any",
    duration_s: float = 10.0,
    *,
    heading_rad: float | None = None,
    speed_m_s: float | None = None,
) -> DrawnWalk:
    """One walk.

    Args:
        rng: all randomness.
        kind: what the person does; `any` is a mixture as people are met. A kind that is named is surely seen in the
            time, one of the mixture when it happens to fall there.
        duration_s: how long it lasts.
        heading_rad: preferred direction at first, clockwise from the second axis; any when omitted.
        speed_m_s: preferred speed; drawn when omitted.
    """
    named = kind != "any"
    chosen: WalkKind = kind if kind != "any" else _met(rng)
    heading = rng.uniform(-math.pi, math.pi) if heading_rad is None else heading_rad
    t = np.arange(0.0, duration_s + 2.0 * _DT_S, _DT_S)
    doing = _Doing(t)
    draw = _EVENTS.get(chosen)
    if draw is not None:
        for at_s in _moments(rng, duration_s, named=named):
            draw(doing, at_s, rng)
    speed = _preferred_speed(chosen, rng) if speed_m_s is None else speed_m_s
    intensity = _intensity(chosen, rng)
    sigma = math.sqrt(0.5 * intensity * _RECALL_S)
    along, across = _processes((Wander(sigma, _RECALL_S, 1),) * 2, len(t), rng).T
    # At time 0 the preferred velocity holds: only what changes from there is wander.
    keeps = np.exp(-t / _RECALL_S)
    along, across = along - keeps * along[0], across - keeps * across[0]
    if chosen == "standing":
        along, across = 0.15 * along, 0.15 * across
    headings = heading + doing.turned_rad
    ahead = doing.pace * (speed + along)
    aside = doing.pace * across + doing.aside_m_s
    forward = np.column_stack((np.sin(headings), np.cos(headings)))
    right = np.column_stack((np.cos(headings), -np.sin(headings)))
    velocity = ahead[:, None] * forward + aside[:, None] * right
    way = np.vstack((np.zeros(2), np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * _DT_S, axis=0)))
    sway = _sway(t, np.clip(np.abs(ahead), 0.3, 1.5), rng)
    swayed = sway[:, :1] * forward + sway[:, 1:] * right
    swayed_velocity = velocity + np.gradient(swayed, _DT_S, axis=0)
    return DrawnWalk(chosen, t, way + swayed - swayed[0], swayed_velocity, doing.stature, *_course(velocity, forward))


def random_walk(
    rng: np.random.Generator, psd_m2_s3: float, duration_s: float, speed_sigma_m_s: float = 1.0
) -> DrawnWalk:
    """A velocity that is truly a random walk per axis, from a velocity drawn with `speed_sigma_m_s` per axis."""
    t = np.arange(0.0, duration_s + 2.0 * _DT_S, _DT_S)
    steps = math.sqrt(psd_m2_s3 * _DT_S) * rng.standard_normal((len(t) - 1, 2))
    first = speed_sigma_m_s * rng.standard_normal(2)
    velocity = first + np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))
    way = np.vstack((np.zeros(2), np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * _DT_S, axis=0)))
    course = _course(velocity, np.zeros((len(t), 2)))
    return DrawnWalk("wandering" if psd_m2_s3 > 0.0 else "calm", t, way, velocity, np.ones(len(t)), *course)


def _course(velocity: Vector, forward: Vector) -> tuple[Vector, Vector]:
    """Where somebody faces (rad), and their speed; who hardly moves faces forward."""
    towards = velocity + _FACING_M_S * forward
    return np.unwrap(np.arctan2(towards[:, 0], towards[:, 1])), np.linalg.norm(velocity, axis=1)


def _met(rng: np.random.Generator) -> WalkKind:
    kinds = list(ANY_SHARES)
    return kinds[int(rng.choice(len(kinds), p=np.array(list(ANY_SHARES.values()))))]


def _preferred_speed(kind: WalkKind, rng: np.random.Generator) -> float:
    if kind == "standing":
        return 0.0
    if kind == "running":
        return float(rng.uniform(2.5, 5.0))
    if kind == "fast":
        return float(rng.uniform(5.0, 9.0))
    if rng.random() < 0.12:
        return float(rng.uniform(0.2, 1.1))
    return float(np.clip(rng.normal(1.48, 0.24), 0.5, 2.4))


def _intensity(kind: WalkKind, rng: np.random.Generator) -> float:
    middle = _WANDERING_PSD if kind in ("wandering", "weaving") else _CALM_PSD
    return float(middle * np.exp(_INTENSITY_SPREAD * rng.standard_normal()))


class _Doing:
    """What a person does beside walking on, at the times `t`: events are added one after the other."""

    def __init__(self, t: Vector) -> None:
        self.t = t
        self.turned_rad = np.zeros(len(t))
        self.pace = np.ones(len(t))
        """Factor on the speed."""
        self.aside_m_s = np.zeros(len(t))
        self.stature = np.ones(len(t))

    def risen(self, at_s: float, over_s: float) -> Vector:
        """0 before `at_s`, 1 from `over_s` later, smooth between."""
        part = np.clip((self.t - at_s) / over_s, 0.0, 1.0)
        return np.asarray(part * part * (3.0 - 2.0 * part))


def _moments(rng: np.random.Generator, duration_s: float, *, named: bool) -> list[float]:
    count = max(int(named), int(rng.poisson(duration_s / _EVENT_EVERY_S)))
    return sorted(rng.uniform(0.05, 0.85, count) * duration_s)


def _turn(doing: _Doing, at_s: float, rng: np.random.Generator) -> None:
    by = math.radians(rng.uniform(30.0, 180.0)) * rng.choice((-1.0, 1.0))
    over_s = rng.uniform(0.6, 1.0) + abs(by) * rng.uniform(0.2, 0.6)
    doing.turned_rad += by * doing.risen(at_s, over_s)
    slower = rng.uniform(0.0, 0.5) * abs(by) / math.pi
    doing.pace *= 1.0 - slower * doing.risen(at_s - 0.4, 0.5) * (1.0 - doing.risen(at_s + over_s, 0.8))


def _stop(doing: _Doing, at_s: float, rng: np.random.Generator) -> None:
    stands_s = rng.exponential(6.0) + 1.0
    doing.pace *= 1.0 - doing.risen(at_s, rng.uniform(0.5, 1.5)) * (1.0 - doing.risen(at_s + stands_s, 1.0))


def _start(doing: _Doing, at_s: float, rng: np.random.Generator) -> None:
    doing.pace *= doing.risen(at_s, rng.uniform(0.5, 1.5))


def _weave(doing: _Doing, at_s: float, rng: np.random.Generator) -> None:
    swing = math.radians(rng.uniform(12.0, 40.0))
    doing.turned_rad += swing * np.sin(2.0 * math.pi * (doing.t - at_s) / rng.uniform(2.5, 7.0))


def _give_way(doing: _Doing, at_s: float, rng: np.random.Generator) -> None:
    aside_m, over_s = rng.uniform(0.3, 0.9) * rng.choice((-1.0, 1.0)), rng.uniform(1.0, 2.2)
    back_s = at_s + over_s + rng.uniform(0.3, 2.0)
    step = doing.risen(at_s, over_s) - rng.choice((0.0, 0.5, 1.0)) * doing.risen(back_s, over_s)
    doing.aside_m_s += np.gradient(aside_m * step, doing.t)


def _greet(doing: _Doing, at_s: float, rng: np.random.Generator) -> None:
    slower, lasts_s = rng.uniform(0.4, 0.9), rng.uniform(1.0, 4.0)
    doing.pace *= 1.0 - slower * doing.risen(at_s, 0.9) * (1.0 - doing.risen(at_s + lasts_s, 1.0))


def _crouch(doing: _Doing, at_s: float, rng: np.random.Generator) -> None:
    lower, over_s, down_s = rng.uniform(0.25, 0.45), rng.uniform(0.7, 1.5), rng.uniform(1.5, 8.0)
    down = doing.risen(at_s, over_s) * (1.0 - doing.risen(at_s + over_s + down_s, over_s))
    doing.stature *= 1.0 - lower * down
    doing.pace *= 1.0 - rng.uniform(0.7, 1.0) * down


_EVENTS: Mapping[WalkKind, Callable[[_Doing, float, np.random.Generator], None]] = {
    "turns": _turn,
    "stops": _stop,
    "starts": _start,
    "weaving": _weave,
    "giving-way": _give_way,
    "greeting": _greet,
    "crouching": _crouch,
}


def _sway(t: Vector, pace_m_s: Vector, rng: np.random.Generator) -> Vector:
    """Of a body over its feet, m (n, 2), ahead and aside: to and fro with each step, and some that is irregular."""
    steps = np.cumsum(2.0 * math.pi * (0.55 + 0.25 * pace_m_s) * _DT_S) + rng.uniform(0.0, 2.0 * math.pi)
    irregular = _processes((Wander(0.02, 0.35), Wander(0.02, 0.35)), len(t), rng)
    size = pace_m_s / 1.4 * math.exp(0.6 * rng.standard_normal())
    ahead = 0.012 * rng.uniform(0.6, 1.4) * np.sin(2.0 * steps)
    aside = 0.02 * rng.uniform(0.6, 1.4) * np.sin(steps)
    return np.asarray(size[:, None] * (np.column_stack((ahead, aside)) + irregular))


def _processes(wanders: tuple[Wander, ...], count: int, rng: np.random.Generator) -> Vector:
    process = GaussMarkov(wanders, _DT_S, rng)
    values = np.empty((count, len(wanders)))
    for row in values:
        row[:] = process.values
        process.step()
    return values
