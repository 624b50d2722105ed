"""Steps in a reported pose: the estimator was reset, and what it reported before is in another frame.

An aircraft does not jump. Between two reports its position changes by what its reported velocity explains, to within
the rounding of the message (a centimetre), and its heading by what it can turn. What is more is a reset of the
estimator (EKF position, velocity or yaw reset), perhaps spread over a few reports. What was reported before is then
moved over to join what is reported after it, so that the path keeps its shape, which is what the parallax is measured
against. Which of the two was nearer to the truth nobody knows, so the direction of the whole stays as uncertain as
the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mission.records import Matrix, NoiseModel, Vector

_STEP_M: Final = 0.2
"""A position that changes by this much more than its velocity explains, within the window, has stepped. In four
recorded flights of ArduCopter and PX4 (11,800 reports) nothing did."""
_PART_M: Final = 0.04
"""Least part of a step that is spread over several reports."""
_WINDOW_S: Final = 0.16
_JOINT_M: Final = 0.05
"""What the length of a step may be wrong by: the reported velocity errs, too, while it settles."""
_TURN_RAD: Final = np.radians(4.0)
"""A heading that changes by this much more than its measured rate explains has stepped; 3.4 degrees were the most
in four recorded flights."""
_PART_RAD: Final = np.radians(0.5)
_TURN_RATE_RAD_S: Final = np.radians(150.0)
"""Where no rate is known, a heading that changes by both between two reports has stepped: no aircraft that looks at
somebody turns so fast."""


@dataclass(frozen=True, slots=True)
class Steps:
    """What was found and undone."""

    position_m: float = 0.0
    """Largest step."""
    heading_rad: float = 0.0
    """Largest step."""
    count: int = 0

    def note(self) -> str:
        """For the operator; empty where there is nothing to tell."""
        found = []
        if self.position_m > 0.0:
            found.append(f"the reported position stepped by {self.position_m:.1f} m")
        if self.heading_rad > 0.0:
            found.append(f"the reported heading stepped by {np.degrees(self.heading_rad):.0f} degrees")
        return f"{' and '.join(found)} ({self.count} in all): the path before was moved to join" if found else ""

    def widened(self, noise: NoiseModel) -> NoiseModel:
        """The noise of poses that were moved: by how much is known to some centimetres, the direction not at all."""
        walk = math.hypot(noise.position_walk_m_per_sqrt_s, _JOINT_M if self.position_m > 0.0 else 0.0)
        bias = math.hypot(noise.heading_bias_sigma_rad, self.heading_rad)
        return replace(noise, position_walk_m_per_sqrt_s=walk, heading_bias_sigma_rad=bias)


def level_positions(t_s: Vector, values: Matrix) -> tuple[Matrix, Vector]:
    """Positions without steps.

    Args:
        t_s: (n,), ascending.
        values: (n, 6), position (m) and velocity (m/s).

    Returns:
        The values, moved to join the newest ones, and the lengths of the steps (k,), metres.
    """
    if len(t_s) < 3:
        return values, np.zeros(0)
    span = np.diff(t_s)
    explained = 0.5 * (values[1:, 3:] + values[:-1, 3:]) * span[:, None]
    jump = np.diff(values[:, :3], axis=0) - explained
    # Rates differ; the velocity's own error over a long gap is no step.
    jump[span > 2.0 * _WINDOW_S] = 0.0
    stepped = _parts(t_s, jump, _WINDOW_S, _STEP_M, _PART_M)
    if not stepped.any():
        return values, np.zeros(0)
    moves = np.where(stepped[:, None], jump, 0.0)
    level = values.copy()
    level[:-1, :3] += np.cumsum(moves[::-1], axis=0)[::-1]
    return level, _gathered_lengths(t_s, moves, stepped, _WINDOW_S)


def level_headings(t_s: Vector, values: Matrix) -> tuple[Matrix, Vector]:
    """Attitudes without steps about the vertical.

    Args:
        t_s: (n,), ascending.
        values: (n, 5), unit quaternions world_from_body in an east-north-up world, and the measured rate of the heading
            (clockwise from above, rad/s), NaN where it is not known.

    Returns:
        The values, turned to join the newest ones, and the steps (k,), radians, positive.
    """
    if len(t_s) < 3:
        return values, np.zeros(0)
    w, x, y, z, rate = values.T
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    span = np.maximum(np.diff(t_s), 1e-4)
    change = (np.diff(yaw) + np.pi) % (2.0 * np.pi) - np.pi
    window = _window_s(t_s)
    if np.isfinite(rate).all():
        jump = change + 0.5 * (rate[1:] + rate[:-1]) * span
        # The rate's own error over a long gap is no step.
        jump[span > 2.0 * _WINDOW_S] = 0.0
        stepped = _parts(t_s, jump[:, None], window, _TURN_RAD, _PART_RAD)
    else:
        jump = _unusual(change, span)
        stepped = jump != 0.0
    if not stepped.any():
        return values, np.zeros(0)
    moves = np.where(stepped, jump, 0.0)
    turn = np.append(np.cumsum(moves[::-1])[::-1], 0.0)
    half = np.column_stack((np.cos(0.5 * turn), np.sin(0.5 * turn)))
    level = np.column_stack(
        (
            half[:, 0] * w - half[:, 1] * z,
            half[:, 0] * x - half[:, 1] * y,
            half[:, 0] * y + half[:, 1] * x,
            half[:, 0] * z + half[:, 1] * w,
            rate,
        )
    )
    return level, _gathered_lengths(t_s, moves[:, None], stepped, window)


def _unusual(change: Vector, span: Vector) -> Vector:
    """By how much headings step, without a measured rate: by what is more than before and after, and than any turn."""
    rate = change / span
    before, after = np.concatenate((rate[:1], rate[:-1])), np.concatenate((rate[1:], rate[-1:]))
    jump = change - np.where(np.abs(before) < np.abs(after), before, after) * span
    stepped = (np.abs(jump) > _TURN_RAD) & (np.abs(jump) > _TURN_RATE_RAD_S * span)
    return np.asarray(np.where(stepped, jump, 0.0))


def _window_s(t_s: Vector) -> float:
    """Within which a step of the heading is over: three reports, where they come often enough.

    The velocity errs too much for that to hold of places: by 0.3 m in 0.4 s on a PX4.
    """
    return float(np.clip(3.5 * np.median(np.diff(t_s)), _WINDOW_S, 2.5 * _WINDOW_S))


def _parts(t_s: Vector, jump: Matrix, window: float, least: float, least_part: float) -> NDArray[np.bool_]:
    """Which of the unexplained changes (n - 1, axes) between reports belong to a step of at least `least`."""
    total = np.vstack((np.zeros(jump.shape[1]), np.cumsum(jump, axis=0)))
    last = np.searchsorted(t_s, t_s[:-1] + window, side="right") - 1
    gathered = np.linalg.norm(total[np.maximum(last, np.arange(1, len(t_s)))] - total[:-1], axis=1)
    inside = np.zeros(len(jump), dtype=bool)
    for first in np.flatnonzero(gathered > least):
        inside[first : max(int(last[first]), first + 1)] = True
    return np.asarray(inside & (np.linalg.norm(jump, axis=1) > least_part))


def _gathered_lengths(t_s: Vector, moves: Matrix, stepped: NDArray[np.bool_], window: float) -> Vector:
    """Lengths of the steps, the parts of one that are within the window taken together."""
    lengths: list[float] = []
    begun_s, total = -np.inf, np.zeros(moves.shape[1])
    for place in np.flatnonzero(stepped):
        if t_s[place] - begun_s > window:
            if total.any():
                lengths.append(float(np.linalg.norm(total)))
            begun_s, total = float(t_s[place]), np.zeros(moves.shape[1])
        total = total + moves[place]
    return np.array([*lengths, float(np.linalg.norm(total))])
