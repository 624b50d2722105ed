"""Sighting-level flights past people who walk as people do, under noise that the header need not tell truly."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mission.planning.pattern import fitted, lateral_path
from mission.records import ClassHeight, NoiseModel, TargetPrior
from mission.settings import PatternSettings
from mission.vehicle.limits import COMPASS_SIGMA_RAD
from sitl.autopilot import wide_family
from sitl.evaluation.accuracy.flights import Pattern, SimulatedFlight, Walk, simulate
from sitl.evaluation.accuracy.rows import CLOSEST_M, in_view
from sitl.people.drawn_walk import KINDS, DrawnWalk, WalkKind, draw_walk, random_walk

Geometry = Literal[
    "default", "s", "down", "one-way", "cut", "half-metre", "first-part", "forward", "accelerating", "along"
]
HeightPrior = Literal["none", "right", "wrong"]

POOR: tuple[Geometry, ...] = ("one-way", "cut", "half-metre", "first-part", "forward", "accelerating", "along")
"""Paths that hardly tell where a target is; `--geometry poor` flies them in turn."""
ADULT_M = (1.71, 0.09)
"""Mean and standard deviation of adults' height, shoes included."""
DISTANCES_M = (4.0, 25.0)
_HEIGHTS_M = (10.0, 60.0)
_DEPRESSIONS_DEG = (30.0, 80.0)
_CAMERA_UP_M = 1.5
_DT_S = 0.1
_WRONG_HEIGHT = 0.2
"""By how much a wrong height is stated too large or too small."""
_TRIES = 10_000


@dataclass(frozen=True, slots=True)
class PeopleSetting:
    """What is flown."""

    walks: str = "real-like"
    """`real-like`, a kind of `sitl.people.drawn_walk`, `straight`, or `random-walk:` with the intensity in m2/s3."""
    geometry: tuple[Geometry, ...] = ("default",)
    """Flown in turn."""
    wide: bool = False
    """Noise out of the wide family, in place of what the header says."""
    noise_scale: float = 1.0
    """The noise that is made over the noise that the header says."""
    heading_bias_rad: float = 0.0
    """Of every flight's compass, to either side, beside the header's."""
    height_prior: HeightPrior = "none"
    class_height: ClassHeight = "use"
    """As the flight states it."""
    height_m: float | None = None
    """Of the people; adults of all heights when None."""


def checked_walks(name: str) -> str:
    """The name of a kind of walk.

    Raises:
        ValueError: there is none of that name.
    """
    if name in ("real-like", "straight", *KINDS):
        return name
    kind, _, psd = name.partition(":")
    if kind == "random-walk" and 0.0 <= _number(psd) < math.inf:
        return name
    raise ValueError(f"{name!r} is none of real-like, straight, {', '.join(KINDS)}, random-walk:PSD")


def _number(text: str) -> float:
    """The number that a text says; NaN when it says none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def people_flight(setting: PeopleSetting, seed: int, number: int) -> SimulatedFlight:
    """The flight of that number: the same whatever else is flown.

    Args:
        setting: what is flown.
        seed: of the campaign.
        number: which flight, from 0.
    """
    rng = np.random.default_rng((seed, number))
    geometry = setting.geometry[number % len(setting.geometry)]
    height = setting.height_m or float(np.clip(rng.normal(*ADULT_M), 1.4, 2.1))
    for _ in range(_TRIES):
        pattern, walk, pitch = _drawn_path(geometry, height, rng)
        person = _drawn_person(setting.walks, float(pattern.t_s[-1]), rng)
        if _closest_m(pattern, walk, person) > CLOSEST_M:
            break
    else:
        raise ValueError(f"no {setting.walks} walk keeps {CLOSEST_M} m from a camera flown {geometry}")
    told = NoiseModel()
    made, claimed = _wide(told, rng) if setting.wide else (scaled(told, setting.noise_scale), told)
    off_m, heading_off = None, setting.heading_bias_rad * float(rng.choice((-1.0, 1.0)))
    if setting.wide:
        off_m = np.zeros((len(pattern.t_s), 3))
        for step in wide_family.drawn_steps(rng, float(pattern.t_s[-1])):
            off_m[:, :2] += step.at(pattern.t_s)
        heading_off += float(rng.uniform(-1.0, 1.0)) * wide_family.COMPASS_OFF_RAD
    sim = simulate(
        pattern,
        walk,
        rng,
        noise=made,
        told=claimed,
        prior=_prior(setting, height, rng),
        pitch_down_rad=pitch,
        start_enu_m=(0.0, 0.0, 0.5 * height - walk.above_camera_m),
        walked=person.at(pattern.t_s),
        reported_off_m=off_m,
        heading_off_rad=heading_off,
        name=f"{geometry}, {person.kind}",
    )
    return sim if pattern.heading_on_target else in_view(sim)


def scaled(noise: NoiseModel, by: float) -> NoiseModel:
    """Every level of the noise times a factor; correlation times stay."""
    return replace(
        noise,
        pixel_sigma_px=by * noise.pixel_sigma_px,
        size_sigma=by * noise.size_sigma,
        position_sigma_m=by * noise.position_sigma_m,
        position_walk_m_per_sqrt_s=by * noise.position_walk_m_per_sqrt_s,
        heading_bias_sigma_rad=by * noise.heading_bias_sigma_rad,
        tilt_bias_sigma_rad=by * noise.tilt_bias_sigma_rad,
        heading_sigma_rad=by * noise.heading_sigma_rad,
        tilt_sigma_rad=by * noise.tilt_sigma_rad,
    )


def _wide(usual: NoiseModel, rng: np.random.Generator) -> tuple[NoiseModel, NoiseModel]:
    """Noise that is made, and noise that is claimed: of the compass what flights write of one that nobody measured.

    The detector's noise is as usual in both.
    """

    def level() -> float:
        return wide_family.factor(rng, wide_family.LEVEL_RANGE)

    def time() -> float:
        return wide_family.factor(rng, wide_family.TIME_RANGE)

    made = replace(
        usual,
        position_sigma_m=level() * usual.position_sigma_m,
        position_walk_m_per_sqrt_s=level() * usual.position_walk_m_per_sqrt_s,
        tilt_bias_sigma_rad=level() * usual.tilt_bias_sigma_rad,
        heading_bias_sigma_rad=0.0,
        heading_sigma_rad=level() * usual.heading_sigma_rad,
        heading_correlation_s=time() * usual.heading_correlation_s,
        tilt_sigma_rad=level() * usual.tilt_sigma_rad,
        tilt_correlation_s=time() * usual.tilt_correlation_s,
    )
    lie = wide_family.factor(rng, wide_family.CLAIM_RANGE)
    claimed = replace(
        usual,
        heading_bias_sigma_rad=COMPASS_SIGMA_RAD,
        position_sigma_m=lie * usual.position_sigma_m,
        position_walk_m_per_sqrt_s=lie * usual.position_walk_m_per_sqrt_s,
    )
    return made, claimed


def _prior(setting: PeopleSetting, height_m: float, rng: np.random.Generator) -> TargetPrior:
    prior = TargetPrior(class_height=setting.class_height)
    if setting.height_prior == "none":
        return prior
    wrong = 0.0 if setting.height_prior == "right" else _WRONG_HEIGHT * float(rng.choice((-1.0, 1.0)))
    return replace(prior, height_m=height_m * (1.0 + wrong) + 0.05 * float(rng.standard_normal()), height_sigma_m=0.05)


def _drawn_person(walks: str, duration_s: float, rng: np.random.Generator) -> DrawnWalk:
    if walks == "real-like":
        return draw_walk(rng, "any", duration_s)
    kind, _, psd = walks.partition(":")
    if kind in ("random-walk", "straight"):
        return random_walk(rng, float(psd or 0.0), duration_s)
    known: WalkKind = next(name for name in KINDS if name == kind)
    return draw_walk(rng, known, duration_s)


def _drawn_path(geometry: Geometry, height_m: float, rng: np.random.Generator) -> tuple[Pattern, Walk, float]:
    """The camera's path, where the target is at first, and how far the camera looks down (rad)."""
    if geometry == "down":
        above = float(rng.uniform(*_HEIGHTS_M))
        down = math.radians(rng.uniform(*_DEPRESSIONS_DEG))
        pattern = _lateral(PatternSettings())
        return pattern, Walk(above / math.tan(down), above_camera_m=-above, height_m=height_m), down
    depth = float(rng.uniform(*DISTANCES_M))
    walk = Walk(depth, above_camera_m=0.5 * height_m - _CAMERA_UP_M, height_m=height_m)
    return _level_path(geometry, depth, rng), walk, 0.0


def _level_path(geometry: Geometry, depth_m: float, rng: np.random.Generator) -> Pattern:
    usual = fitted(PatternSettings(), depth_m)
    whole = _lateral(usual)
    if geometry == "s":
        return _lateral(usual.model_copy(update={"kind": "s"}))
    if geometry == "one-way":
        return _first(whole, usual.leg_duration_s)
    if geometry == "cut":
        return _first(_lateral(usual.model_copy(update={"leg_duration_s": 6.0})), 3.0)
    if geometry == "half-metre":
        return _lateral(usual.model_copy(update={"length_m": 0.5}))
    if geometry == "first-part":
        return _first(whole, float(rng.uniform(0.10, 0.33)) * float(whole.t_s[-1]))
    if geometry in ("forward", "accelerating"):
        t = np.arange(0.0, 4.0 + 0.5 * _DT_S, _DT_S)
        speed = float(rng.uniform(0.3, 2.0))
        ahead = speed * t if geometry == "forward" else 0.5 * (0.5 * speed) * t**2
        return Pattern(geometry, t, np.column_stack((0.0 * t, ahead, 0.0 * t)))
    if geometry == "along":
        t = np.arange(0.0, 6.0 + 0.5 * _DT_S, _DT_S)
        left = float(rng.choice((-1.0, 1.0)) * rng.uniform(0.5, 2.0)) * t
        return Pattern(geometry, t, np.column_stack((left, 0.0 * t, 0.0 * t)), heading_on_target=False)
    return whole


def _lateral(settings: PatternSettings) -> Pattern:
    """As the mission flies it, ten sightings a second."""
    knots = lateral_path(settings, 0.0).knots
    ends = np.array([k.t_s for k in knots])
    t = np.arange(0.0, ends[-1] + 0.5 * _DT_S, _DT_S)
    left = -np.interp(t, ends, np.array([k.offset_enu_m[0] for k in knots]))
    return Pattern(settings.kind, t, np.column_stack((left, 0.0 * t, 0.0 * t)))


def _first(pattern: Pattern, duration_s: float) -> Pattern:
    count = max(4, int(np.searchsorted(pattern.t_s, duration_s + 1e-6)))
    return replace(pattern, t_s=pattern.t_s[:count], left_ahead_up_m=pattern.left_ahead_up_m[:count])


def _closest_m(pattern: Pattern, walk: Walk, person: DrawnWalk) -> float:
    """The smallest distance of camera and target."""
    way = person.at(pattern.t_s).way_m
    across = way[:, 0] + pattern.left_ahead_up_m[:, 0]
    along = walk.depth_m + way[:, 1] - pattern.left_ahead_up_m[:, 1]
    return float(np.sqrt(across**2 + along**2 + walk.above_camera_m**2).min())
