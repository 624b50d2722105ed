"""How a person walks: cadence from speed, the feet's path over the stride, swinging arms, an idle sway when standing.

What is published and what is chosen:

- Cadence: people keep their walk ratio (step length over cadence) at ordinary speeds; below about 1 m/s it rises (R.
  Murakami and Y. Otaka, *J. Phys. Ther. Sci.* 29 (2017) 722). Here it is one figure at all speeds, chosen so that
  1.35 m/s gives a stride of 1.45 m: slow walkers step a little shorter and quicker than people do.
- Feet: a foot is on the ground for about 60 % of a stride in free walking (J. Perry, "Normal Gait", in *Atlas of Limb
  Prosthetics*, 2nd ed., chapter 13). When the heel rises, and how far the foot pitches and lifts, are chosen.
- Hip and knee follow from the feet and the pelvis (two-link leg), so that the planted foot does not slide; the tests
  hold the angles that come out against what textbooks give.
- Arms: an arc of about 30 degrees, furthest back when the foot of the same side strikes (J. Perry, *Gait Analysis*,
  1992, chapter 8). The curve between is chosen.
- Rise and fall of the trunk: six tenths of what stiff legs would give, 4.6 cm at 1.35 m/s: chosen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from mission.records import Vector
from sitl.people.body import (
    BALL,
    CALF,
    CLAVICLE,
    FOOT,
    HAND,
    LOWER_ARM,
    NECK,
    PELVIS,
    REST_HEIGHT_M,
    RIGHT,
    SPINE_1,
    SPINE_3,
    THIGH,
    UPPER_ARM,
    read_body,
)

WALK_RATIO_M_MIN = 0.0065
"""Step length over cadence, m / (steps / min), for a body of 1.75 m; a chosen round figure."""

FREE_STRIDE_M = 1.41
"""Stride of free walking (about 1.35 m/s): arms and feet swing less in shorter ones."""

_ARM_PHASE = np.array([0.00, 0.06, 0.12, 0.20, 0.30, 0.40, 0.50, 0.57, 0.62, 0.68, 0.73, 0.80, 0.87, 0.94, 1.00])
_SHOULDER_DEG = np.array([-18.0, -17.0, -15.0, -10.5, -3.5, 4.5, 10.0, 11.0, 10.0, 6.5, 2.5, -4.5, -11.5, -16.5, -18.0])
_ELBOW_DEG = np.array([14.0, 14.0, 15.0, 18.0, 23.0, 28.0, 32.0, 32.0, 30.0, 26.0, 22.0, 18.0, 15.0, 14.0, 14.0])
"""Flexion of the arm on the SAME side as the foot whose strike is phase 0: it swings against its leg."""
_SHOULDER, _ELBOW = (
    CubicSpline(_ARM_PHASE, np.radians(table), bc_type="periodic") for table in (_SHOULDER_DEG, _ELBOW_DEG)
)

_SWING_PART = np.array([0.0, 0.18, 0.40, 0.60, 0.80, 1.0])
_SWING_PITCH = np.array([1.0, 1.02, 0.45, 0.05, -0.25, -0.36])
_SWING_LIFT_M = np.array([0.0, 0.045, 0.045, 0.030, 0.020, 0.0])
_PITCH_SHAPE, _LIFT_SHAPE = (PchipInterpolator(_SWING_PART, table) for table in (_SWING_PITCH, _SWING_LIFT_M))
_TOE_OFF_PITCH = math.radians(56.0)
"""The foot's pitch, toes down, at toe-off in free walking; heel strike is at 0.36 of it, toes up."""

_HEELS_FLAT = 0.09
_HEEL_RISES = 0.30
"""Phases at which the forefoot comes down and the heel leaves the ground."""


@dataclass(frozen=True, slots=True)
class _Leg:
    """One leg's lengths, metres, from the mesh."""

    thigh_m: float
    calf_m: float
    ankle_up_m: float
    heel_back_m: float
    ball_ahead_m: float


def _measure_leg() -> _Leg:
    body = read_body()
    hip, knee, ankle, ball = (body.heads_m[bone] for bone in (THIGH, CALF, FOOT, BALL))
    sole = body.vertices_m[(body.vertices_m[:, 2] < 0.01) & (body.vertices_m[:, 1] > 0.0)]
    return _Leg(
        thigh_m=float(np.linalg.norm(knee - hip)),
        calf_m=float(np.linalg.norm(ankle - knee)),
        ankle_up_m=float(ankle[2]),
        heel_back_m=float(ankle[0] - sole[:, 0].min()),
        ball_ahead_m=float(ball[0] - ankle[0]),
    )


_LEG = _measure_leg()


def stride_m(speed_m_s: float, height_m: float = REST_HEIGHT_M) -> float:
    """Length of a stride (two steps) at a walking speed, metres; scales with the body."""
    if speed_m_s <= 0.0:
        return 0.0
    scale = height_m / REST_HEIGHT_M
    cadence_per_min = math.sqrt(60.0 * speed_m_s / (WALK_RATIO_M_MIN * scale))
    return 2.0 * WALK_RATIO_M_MIN * scale * cadence_per_min


def pose(phase: float, stride_m: float, t_s: float, seed: int = 0) -> Vector:
    """Pose the body somewhere in its stride, on the ground.

    Args:
        phase: 0 to 1, from the left heel's strike to the next; it is the way travelled over the stride's length.
        stride_m: length of the stride for the mesh's own height of 1.75 m; 0 is standing.
        t_s: any time; people who stand sway slowly with it.
        seed: makes people sway differently.

    Returns:
        (V, 3), metres; x forward, y left, z up. Adding the way travelled to x keeps the planted foot where it is.
    """
    still = max(0.0, 1.0 - stride_m / 0.5)
    sway_x_m, sway_y_m = (still * sway for sway in _idle_sway_m(t_s, seed))
    moving = 1.0 - still
    side_m = sway_y_m - 0.012 * moving * math.cos(2.0 * math.pi * (phase - 0.30))
    size = min(1.3, stride_m / FREE_STRIDE_M)
    root = np.array([sway_x_m, side_m, _pelvis_drop_m(phase, stride_m)])
    rotations = _trunk_and_arms(phase, size)
    body = read_body()
    pelvis = body.heads_m[PELVIS] + root
    for side, start in ((0, 0.0), (RIGHT, 0.5)):
        foot = _foot((phase + start) % 1.0, stride_m)
        hip = pelvis + rotations[PELVIS] @ (body.heads_m[THIGH + side] - body.heads_m[PELVIS])
        thigh, knee = _leg_angles(foot.ankle_x_m - hip[0], foot.ankle_z_m - hip[2])
        sideways = _about_x(-math.atan(side_m / hip[2]))
        rotations[THIGH + side] = sideways @ _about_y(-thigh) @ _UPRIGHT[THIGH + side]
        rotations[CALF + side] = sideways @ _about_y(knee - thigh) @ _UPRIGHT[CALF + side]
        rotations[FOOT + side] = _about_y(foot.pitch)
        rotations[BALL + side] = _about_y(foot.pitch - foot.toe_bend)
    return body.pose(rotations, root)


def joint_angles(phase: float, stride_m: float) -> tuple[float, float, float]:
    """Thigh flexion from the vertical, knee flexion and ankle dorsiflexion of the left leg, radians."""
    foot = _foot(phase, stride_m)
    hip_z_m = float(read_body().heads_m[THIGH][2]) + _pelvis_drop_m(phase, stride_m)
    thigh, knee = _leg_angles(foot.ankle_x_m - float(read_body().heads_m[THIGH][0]), foot.ankle_z_m - hip_z_m)
    return thigh, knee, knee - thigh - foot.pitch


@dataclass(frozen=True, slots=True)
class _Foot:
    """Where a foot is in the body's frame: its ankle, its pitch (toes down) and how far the toes bend up."""

    ankle_x_m: float
    ankle_z_m: float
    pitch: float
    toe_bend: float


def _stance_share(stride_m: float) -> float:
    """Part of the stride in which a foot is on the ground: 0.61 in free walking, and a chosen bit more in slow."""
    return 0.70 - 0.064 * min(stride_m, 2.0)


def _foot(phase: float, stride_m: float) -> _Foot:
    """A foot's place at a phase since its own heel strike."""
    stance = _stance_share(stride_m)
    size = min(1.0, stride_m / FREE_STRIDE_M)
    strike = _TOE_OFF_PITCH * size * float(_SWING_PITCH[-1])
    if phase < stance:
        flat_x_m = stride_m * (0.5 * stance - 0.08 - phase)
        if phase < _HEELS_FLAT:
            return _pivot(flat_x_m, -_LEG.heel_back_m, strike * (1.0 - _smooth(phase / _HEELS_FLAT)), 0.0)
        if phase < _HEEL_RISES:
            return _pivot(flat_x_m, 0.0, 0.0, 0.0)
        rise = (phase - _HEEL_RISES) / (stance - _HEEL_RISES)
        pitch = _TOE_OFF_PITCH * size * rise**2
        return _pivot(flat_x_m, _LEG.ball_ahead_m, pitch, 0.75 * pitch)
    part = (phase - stance) / (1.0 - stance)
    lift_off = _foot(stance * (1.0 - 1e-9), stride_m)
    touch_down = _foot(0.0, stride_m)
    s = _hermite(part, -0.35 * (1.0 - stance) * stride_m, -0.8 * (1.0 - stance) * stride_m)
    pitch = _TOE_OFF_PITCH * size * float(_PITCH_SHAPE(part))
    x_m = lift_off.ankle_x_m * s[0] + touch_down.ankle_x_m * s[1] + s[2]
    eased = _smooth(part)
    z_m = lift_off.ankle_z_m * (1.0 - eased) + touch_down.ankle_z_m * eased + size * float(_LIFT_SHAPE(part))
    return _Foot(x_m, z_m, pitch, lift_off.toe_bend * max(0.0, 1.0 - 3.0 * part))


def _pivot(flat_x_m: float, pivot_x_m: float, pitch: float, toe_bend: float) -> _Foot:
    """The ankle of a foot that has turned about a point of its sole which stays on the ground."""
    c, s = math.cos(pitch), math.sin(pitch)
    return _Foot(
        flat_x_m + pivot_x_m - pivot_x_m * c + _LEG.ankle_up_m * s,
        pivot_x_m * s + _LEG.ankle_up_m * c,
        pitch,
        toe_bend,
    )


def _leg_angles(x_m: float, z_m: float) -> tuple[float, float]:
    """Thigh flexion from the vertical and knee flexion that bring the ankle to (x, z) from the hip."""
    a, b = _LEG.thigh_m, _LEG.calf_m
    reach = min(math.hypot(x_m, z_m), 0.9995 * (a + b))
    knee = math.pi - math.acos((a * a + b * b - reach * reach) / (2.0 * a * b))
    thigh = math.atan2(x_m, -z_m) + math.acos((a * a + reach * reach - b * b) / (2.0 * a * reach))
    return thigh, knee


def _bob_m(phase: float, stride_m: float) -> float:
    """Rise of the trunk: highest in the middle of single support, twice a stride."""
    step_m = stride_m / 2.0
    stiff_m = step_m**2 / (8.0 * (_LEG.thigh_m + _LEG.calf_m))
    return 0.5 * 0.6 * stiff_m * math.cos(4.0 * math.pi * (phase - 0.31))


_STRIDES_M = np.linspace(0.0, 2.4, 49)


def _pelvis_heights() -> Vector:
    """How far the pelvis must come down (on average) so that no planted foot is out of the leg's reach, per stride."""
    reach_m = 0.9965 * (_LEG.thigh_m + _LEG.calf_m)
    hip = read_body().heads_m[THIGH]
    lowest = []
    for length_m in _STRIDES_M:
        room = []
        for phase in np.arange(0.0, _stance_share(length_m), 0.02):
            foot = _foot(float(phase), float(length_m))
            across_m = foot.ankle_x_m - hip[0]
            room.append(
                foot.ankle_z_m + math.sqrt(reach_m**2 - across_m**2) - hip[2] - _bob_m(float(phase), float(length_m))
            )
        lowest.append(min(room))
    return np.array(lowest)


def _pelvis_drop_m(phase: float, stride_m: float) -> float:
    """Height of the pelvis relative to the rest pose (negative: lower)."""
    return float(np.interp(stride_m, _STRIDES_M, _PELVIS_HEIGHTS_M)) + _bob_m(phase, stride_m)


def _smooth(part: float) -> float:
    return part * part * (3.0 - 2.0 * part)


def _hermite(part: float, slope_0: float, slope_1: float) -> tuple[float, float, float]:
    """Weights of the two ends, and what the end slopes add, of a cubic Hermite segment."""
    s = _smooth(part)
    return 1.0 - s, s, part * (1.0 - part) ** 2 * slope_0 + part**2 * (part - 1.0) * slope_1


def _idle_sway_m(t_s: float, seed: int) -> tuple[float, float]:
    """Slow drift of a standing body's weight, forward and left, about a centimetre."""
    a, b, c, d = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, 4)
    forward = 0.006 * math.sin(2.0 * math.pi * 0.23 * t_s + a) + 0.003 * math.sin(2.0 * math.pi * 0.61 * t_s + b)
    left = 0.008 * math.sin(2.0 * math.pi * 0.13 * t_s + c) + 0.002 * math.sin(2.0 * math.pi * 0.47 * t_s + d)
    return forward, left


def _trunk_and_arms(phase: float, size: float) -> Vector:
    """(B, 3, 3): each bone's rotation from rest, in the body's frame; the legs are filled in later."""
    rotations = np.tile(np.eye(3), (22, 1, 1))
    turn = math.cos(2.0 * math.pi * phase)
    # The pelvis follows the leading leg and the shoulders turn against it, a few degrees each.
    rotations[PELVIS] = _about_z(math.radians(-4.0) * size * turn)
    chest = _about_z(math.radians(5.0) * size * turn) @ _about_y(math.radians(2.0) * size)
    rotations[SPINE_1 : SPINE_3 + 1] = chest
    rotations[NECK : NECK + 2] = np.eye(3)
    for side, start in ((0, 0.0), (RIGHT, 0.5)):
        p = (phase + start) % 1.0
        shoulder, elbow = size * float(_SHOULDER(p)), size * float(_ELBOW(p)) + math.radians(8.0)
        rotations[CLAVICLE + side] = chest
        rotations[UPPER_ARM + side] = chest @ _about_y(-shoulder) @ _UPRIGHT[UPPER_ARM + side]
        rotations[LOWER_ARM + side] = chest @ _about_y(-shoulder - elbow) @ _UPRIGHT[LOWER_ARM + side]
        rotations[HAND + side] = rotations[LOWER_ARM + side]
    return rotations


def _about_x(angle: float) -> Vector:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _about_y(angle: float) -> Vector:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _about_z(angle: float) -> Vector:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _upright() -> Vector:
    """(B, 3, 3): turns the limbs of the rest pose (legs apart, arms lifted) to hang down."""
    heads = read_body().heads_m
    turns = np.tile(np.eye(3), (22, 1, 1))
    for side, left in ((0, 1.0), (RIGHT, -1.0)):
        leg_in, arm_out = math.radians(1.5), math.radians(9.0)
        leg = np.array([0.0, -left * math.sin(leg_in), -math.cos(leg_in)])
        arm = np.array([0.0, left * math.sin(arm_out), -math.cos(arm_out)])
        forearm = np.array([0.0, left * math.sin(arm_out / 3.0), -math.cos(arm_out / 3.0)])
        wanted = ((THIGH, CALF, leg), (CALF, FOOT, leg), (UPPER_ARM, LOWER_ARM, arm), (LOWER_ARM, HAND, forearm))
        for bone, end, direction in wanted:
            turns[bone + side] = _turn_between(heads[end + side] - heads[bone + side], direction)
    return turns


def _turn_between(start: Vector, end: Vector) -> Vector:
    """The smallest rotation that takes one direction to another (Rodrigues)."""
    a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(a, b)
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + float(a @ b)))


_UPRIGHT = _upright()
_PELVIS_HEIGHTS_M = _pelvis_heights()
