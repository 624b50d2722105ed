"""How people move, as a set of hypotheses with prior probabilities that an estimate is averaged over.

Nobody walks a straight line at constant speed for six seconds: velocities of walking people are close to random walks
whose intensity differs from person to person by two orders of magnitude (typically 0.005 m2/s3 per axis, heavy
tails), and some turn, stop or start within a second, weave, or change their posture. Each hypothesis is a Gaussian
process of the deviation from constant velocity, per horizontal axis, zero at the time that the place is asked for:

- a random walk of the velocity of one intensity (white-noise acceleration; Bar-Shalom, Li & Kirubarajan 6.2.2),
- the same with one change of velocity within about a second, at one of several times,
- the same with a sideways oscillation (weaving),
- the same with changes of posture: the logarithm of the apparent height is a random walk, and the centre goes with it.

Which of them is true is not decided: the marginal likelihood of the sightings weighs them (`marginal.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from mission.estimate.kernels import integrated_random_walk, random_walk_by_place
from mission.records import Matrix, TargetPrior, Vector

MotionKind = Literal["steady", "wandering", "turning", "weaving", "posture"]

_INTENSITIES: Final = (
    (0.0, 0.2),
    (0.001, 0.16),
    (0.004, 0.16),
    (0.016, 0.14),
    (0.06, 0.08),
    (0.25, 0.04),
    (1.0, 0.015),
)
"""Of the velocity's random walk, m2/s3, and prior probabilities."""
_CALM = 0.001
"""Intensities up to this are a steady walk to a person who reads it."""
_USUAL = 0.004
"""Intensity beside a turn, weaving or a change of posture."""
_TURNS, _TURNING, _TURN_SIGMA_M_S, _TURN_S = 8, 0.14, 1.2, 0.8
"""Times tried, probability of all of them, change of velocity per axis, and how long it takes."""
_WEAVING: Final = ((1.6, 0.3, 0.015), (2.6, 0.2, 0.015))
"""Angular rate (rad/s), amplitude's sigma (m) and probability."""
_POSTURE, _POSTURE_SIGMA, _POSTURE_MODES = 0.05, 1.2, 8
"""Probability, what the log height may change by in a flight, and how many waves of its random walk are kept."""
SPEEDS: Final = ((0.05, 0.08), (1.0, 0.72), (2.5, 0.15), (8.0, 0.05))
"""The prior's speed sigma is multiplied by these, with these probabilities: some stand, some run or ride."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One way to move."""

    kind: MotionKind
    log_prior: float
    place: Matrix
    """(k + 2, k + 2), covariance per axis of the deviation at the knots, and of it and its rate at the end."""
    posture: bool = False
    """Whether the posture changes, too (`posture_modes`)."""


def motion_hypotheses(t_s: Vector, averaging: Matrix, prior: TargetPrior) -> tuple[Hypothesis, ...]:
    """The hypotheses of a flight.

    Args:
        t_s: times of the sightings, (n,), zero where the deviation is.
        averaging: weights (k, n) of the knots.
        prior: an `acceleration_psd_m2_s3` above zero tells the intensity, and is then the only hypothesis.
    """
    begin, end = float(t_s[0]), float(t_s[-1])
    wander = _with_end(t_s, averaging)
    told = prior.acceleration_psd_m2_s3
    if told > 0.0:
        return (Hypothesis("wandering", 0.0, told * wander),)
    found = [
        Hypothesis("steady" if psd <= _CALM else "wandering", math.log(share), psd * wander)
        for psd, share in _INTENSITIES
    ]
    for turn in begin + (np.arange(_TURNS) + 0.5) / _TURNS * (end - begin):
        path, rate = _turned(t_s, turn), _turned_rate(end, turn)
        row = np.concatenate((averaging @ path, [path[-1], rate]))
        share = math.log(_TURNING / _TURNS)
        found.append(Hypothesis("turning", share, _USUAL * wander + _TURN_SIGMA_M_S**2 * np.outer(row, row)))
    for rate_rad_s, sigma_m, share in _WEAVING:
        weave = sigma_m**2 * _oscillation(t_s, averaging, rate_rad_s)
        found.append(Hypothesis("weaving", math.log(share), _USUAL * wander + weave))
    found.append(Hypothesis("posture", math.log(_POSTURE), _USUAL * wander, posture=True))
    return tuple(found)


def posture_modes(t_s: Vector) -> Matrix:
    """What each wave of a changing posture adds to the log height at the sightings, one sigma of it, (P, n).

    The random walk's own waves (Karhunen-Loeve; Papoulis, Probability, Random Variables and Stochastic Processes, 11).
    """
    span = max(float(np.ptp(t_s)), 1e-6)
    rates = (np.arange(_POSTURE_MODES) + 0.5) * np.pi
    waves = math.sqrt(2.0) * np.sin(rates[:, None] * (t_s - t_s[0]) / span) / rates[:, None]
    return np.asarray(_POSTURE_SIGMA * waves)


def _with_end(t_s: Vector, averaging: Matrix) -> Matrix:
    """Of the velocity's unit random walk: knots, then the last place and velocity."""
    last = t_s[-1:]
    count = len(averaging)
    whole = np.empty((count + 2, count + 2))
    whole[:count, :count] = averaging @ integrated_random_walk(t_s, t_s) @ averaging.T
    whole[count, :count] = whole[:count, count] = averaging @ integrated_random_walk(t_s, last)[:, 0]
    whole[count + 1, :count] = whole[:count, count + 1] = averaging @ random_walk_by_place(last, t_s)[0]
    whole[count, count] = last[0] ** 3 / 3.0
    whole[count, count + 1] = whole[count + 1, count] = last[0] ** 2 / 2.0
    whole[count + 1, count + 1] = last[0]
    return whole


def _turned(t_s: Vector, turn_s: float) -> Vector:
    """Way made since t = 0 by a change of velocity of 1 m/s around a time, (n,)."""
    since = np.append(0.0, t_s) - (turn_s - 0.5 * _TURN_S)
    way = 0.5 * np.clip(since, 0.0, _TURN_S) ** 2 / _TURN_S + np.maximum(since - _TURN_S, 0.0)
    return np.asarray(way[1:] - way[0])


def _turned_rate(end_s: float, turn_s: float) -> float:
    """Share of the change of velocity that is done at the end."""
    return float(np.clip((end_s - turn_s) / _TURN_S + 0.5, 0.0, 1.0))


def _oscillation(t_s: Vector, averaging: Matrix, rate_rad_s: float) -> Matrix:
    """An oscillation of unit amplitude and any phase, less its place at t = 0."""
    waves = np.column_stack((np.sin(rate_rad_s * t_s), np.cos(rate_rad_s * t_s) - 1.0))
    rate = rate_rad_s * np.array((math.cos(rate_rad_s * t_s[-1]), -math.sin(rate_rad_s * t_s[-1])))
    whole = np.vstack((averaging @ waves, waves[-1], rate))
    return np.asarray(whole @ whole.T)
