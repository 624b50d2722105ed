"""What the AR.Drone's own errors cost, without pictures or real time: the twelve rows many times over.

    python -m sitl.evaluation.ardrone.reckoned [--noise good] [--flights 8] [--scale-percent 0]

Each flight follows its pattern exactly; the person is the scenario's, walking evenly from the first image on. What is
drawn are the aircraft's sensors (`sitl.ardrone.sensors`, integrated as `mission.vehicle.ardrone.reckoning` does) and
the errors of the tracker. Every set of sightings is estimated four times: as the aircraft reckoned, with the path's
shape by the background as the mission does it (`sitl.evaluation.ardrone.steadied`), with perfect dead reckoning, and as
reckoned by the formula of Kim & Yow 2015 for the row's class. No renderer, no wire: it tells what the aircraft allows,
not what a flight gets.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer
from scipy.spatial.transform import Rotation

from mission.camera.model import CameraModel
from mission.errors import EstimateRefused
from mission.estimate import ESTIMATORS
from mission.estimate.noise_fit import with_fitted_noise
from mission.planning.pattern import fitted, lateral_path
from mission.pose.buffer import world_from_body
from mission.records import FlightSightings, GeodeticOrigin, Matrix, Sighting, Vector
from mission.settings import PatternSettings
from mission.track.noise import PIXEL_CORRELATION_S, SIZE_CORRELATION_S, pixel_sigma_px, size_sigma
from mission.vehicle.ardrone.pose_quality import noise_model
from mission.vehicle.ardrone.reckoning import Reckoning
from mission.vehicle.path_follower import setpoint_at
from mission.video.square import square_camera
from sitl.ardrone.sensors import PRESETS, SensorNoise, Sensors
from sitl.camera.airframe import body_from_camera
from sitl.evaluation.ardrone.rows import ARDRONE_ROWS, ArdroneRow, paper_images
from sitl.evaluation.ardrone.steadied import steadied
from sitl.evaluation.ardrone.truth import of_truth
from sitl.people.world import World
from sitl.scenario.schema import read_scenario
from sitl.simulation.processes import camera_of

_DT = 0.02
_FRAME_TICKS = 3
"""16.7 pictures a second."""
_HEIGHT_M = 1.0
_AIM_ERROR_RAD = 0.03
_WALKED_S = 1.0


@dataclass(frozen=True, slots=True)
class Reckoned:
    """Depth errors of one flight, percent; NaN where there is no answer."""

    reckoned: float
    steadied: float
    undrifted: float
    formula: float


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """One flight's n sightings."""

    told: FlightSightings
    """As reckoned."""
    true: FlightSightings
    """The same pixels, with the true poses."""
    depth_m: tuple[float, ...]
    """(n), the target's true distance from the first place."""


def fly_reckoned(row: ArdroneRow, noise: SensorNoise, rng: np.random.Generator) -> Reckoned:
    """One drawn flight of a row with each of the two patterns.

    Args:
        row: the case.
        noise: sizes of the aircraft's errors.
        rng: draws them and the tracker's.
    """
    drawn = _drawn(row, PatternSettings(), noise, rng)
    told, true, depth = drawn.told, drawn.true, drawn.depth_m[0]
    reckoned = _error("batch", with_fitted_noise(told, steadied=False), depth)
    by_background = steadied(told, true)
    held = _error("batch", with_fitted_noise(by_background, steadied=True), depth)
    undrifted = _error("batch", with_fitted_noise(true, steadied=True), depth)
    drawn = _drawn(row, PatternSettings(kind="paper"), noise, rng)
    try:
        images = paper_images(drawn.told)
    except EstimateRefused:
        return Reckoned(reckoned, held, undrifted, math.nan)
    last = drawn.told.sightings.index(images.sightings[-1])
    formula = "three-image" if row.motion == "parallel" else "stereo"
    truth = drawn.depth_m[last if row.motion == "perpendicular" else 0]
    return Reckoned(reckoned, held, undrifted, _error(formula, images, truth))


def _error(name: str, flight: FlightSightings, depth_m: float) -> float:
    try:
        return 100.0 * abs(ESTIMATORS[name].estimate(flight).depth_m - depth_m) / depth_m
    except EstimateRefused:
        return math.nan


def _drawn(row: ArdroneRow, pattern: PatternSettings, noise: SensorNoise, rng: np.random.Generator) -> _Drawn:
    scenario = read_scenario(row.scenario)
    scenario = scenario.model_copy(update={"seed": int(rng.integers(2**31))})
    world, camera = World(scenario), square_camera(camera_of(scenario))
    lens = camera.intrinsics
    model, lever = CameraModel(lens), np.array(scenario.camera.position_body_m)
    start = world.person_centroid(0, 0.0, -_WALKED_S)
    bearing = math.atan2(start[0], start[1])
    path = lateral_path(fitted(pattern, row.depth_m), bearing)
    sensors = Sensors(noise, _DT, rng)
    sensors.flat_trim()
    phases, errors = rng.uniform(0.0, 2.0 * math.pi, 2), rng.standard_normal(3)
    reckoned, target = np.zeros(2), start
    fades = np.exp(-_DT / np.array([PIXEL_CORRELATION_S, PIXEL_CORRELATION_S, SIZE_CORRELATION_S]))
    told: list[Sighting] = []
    true: list[Sighting] = []
    depths: list[float] = []
    first: Vector | None = None
    for tick in range(round(path.duration_s / _DT)):
        t_s, error = tick * _DT, sensors.step()
        flown = setpoint_at(path, t_s, np.array([0.0, 0.0, -_HEIGHT_M]))
        place, velocity = _enu(flown.position_ned_m), _enu(flown.velocity_ned_m_s)[:2]
        if tick % _FRAME_TICKS == 0:
            target = world.person_centroid(0, t_s, -_WALKED_S)
        east, north, _ = target - place
        sway = _AIM_ERROR_RAD * (math.sin(1.7 * t_s + phases[0]) + math.sin(3.1 * t_s + phases[1])) / 2.0
        heading = bearing if pattern.kind == "paper" else math.atan2(east, north) + sway
        s, c = math.sin(heading), math.cos(heading)
        flow = (1.0 + error.flow_scale) * np.array([velocity @ (s, c), velocity @ (c, -s)]) + error.flow_m_s
        s, c = math.sin(heading + error.heading_rad), math.cos(heading + error.heading_rad)
        reckoned = reckoned + _DT * np.array([flow[0] * s + flow[1] * c, flow[0] * c - flow[1] * s])
        errors = fades * errors + np.sqrt(1.0 - fades * fades) * rng.standard_normal(3)
        if tick % _FRAME_TICKS:
            continue
        attitude = world_from_body(0.0, 0.0, heading)
        turn, centre = _camera(attitude, place, lever)
        first = centre if first is None else first
        point = turn.T @ (target - centre)
        if not model.in_reach(point):
            break
        tall = lens.fy * scenario.people[0].height_m / float(point[2])
        sigma = pixel_sigma_px(tall, 0.0, False)
        pixel = model.project(point) + 0.7 * sigma * errors[:2]
        whole = pixel[1] - 0.5 * tall > 0.0 and pixel[1] + 0.5 * tall < lens.height_px
        size = (tall * math.exp(size_sigma(tall, 0.0) * errors[2]), size_sigma(tall, 0.0)) if whole else (None, None)
        if not (0.0 < pixel[0] < lens.width_px and 0.0 < pixel[1] < lens.height_px):
            break
        believed = world_from_body(error.roll_rad, error.pitch_rad, heading + error.heading_rad)
        there = np.array([*reckoned, _HEIGHT_M + error.height_m])
        told.append(_sighting(t_s, pixel, sigma, size, *_camera(believed, there, lever)))
        true.append(_sighting(t_s, pixel, sigma, size, turn, centre))
        depths.append(float(np.linalg.norm((target - first)[:2])))
    reckoning = Reckoning()
    reckoning.magnetic = True
    stated = replace(
        noise_model(reckoning, declination_known=True),
        pixel_correlation_s=PIXEL_CORRELATION_S,
        size_correlation_s=SIZE_CORRELATION_S,
    )
    origin, widened = GeodeticOrigin(0.0, 0.0, 0.0), camera.widen(stated)
    return _Drawn(
        FlightSightings("reckoned", origin, lens, tuple(told), widened),
        FlightSightings("true", origin, lens, tuple(true), camera.widen(of_truth(stated))),
        tuple(depths),
    )


def _enu(ned: Vector) -> Vector:
    return np.array([ned[1], ned[0], -ned[2]])


def _camera(attitude_wxyz: Vector, place: Vector, lever: Vector) -> tuple[Matrix, Vector]:
    body = Rotation.from_quat(attitude_wxyz, scalar_first=True)
    return body.as_matrix() @ body_from_camera(0.0), place + body.apply(lever)


def _sighting(
    t_s: float,
    pixel: Vector,
    sigma_px: float,
    size: tuple[float | None, float | None],
    turn: Matrix,
    place: Vector,
) -> Sighting:
    w, x, y, z = Rotation.from_matrix(turn).as_quat(scalar_first=True).tolist()
    east, north, up = place.tolist()
    across, down = pixel.tolist()
    return Sighting(t_s, (east, north, up), (w, x, y, z), (across, down), size[0], sigma_px, size[1])


def flights(noise: SensorNoise, count: int, seed: int) -> Iterator[tuple[ArdroneRow, list[Reckoned]]]:
    """All rows, each flown that often."""
    for number, row in enumerate(ARDRONE_ROWS):
        yield row, [fly_reckoned(row, noise, np.random.default_rng([seed, number, k])) for k in range(count)]


def main(
    noise: Annotated[str, typer.Option(help="good, rough or none.")] = "good",
    count: Annotated[int, typer.Option("--flights", help="Of each row.")] = 8,
    seed: int = 1,
    scale_percent: Annotated[float | None, typer.Option(help="Of the flow, instead of the preset's.")] = None,
) -> None:
    """Print the median, 95th percentile and worst depth error of each row and of all."""
    chosen = next(preset for name, preset in PRESETS.items() if name == noise)
    if scale_percent is not None:
        chosen = replace(chosen, flow_scale=scale_percent / 100.0)
    everything: list[Reckoned] = []
    for row, flown in flights(chosen, count, seed):
        everything += flown
        typer.echo(f"{row.motion:13s} {row.depth_m:5.2f} m  {_line(flown)}")
    typer.echo(f"all rows               {_line(everything)}")


def _line(flown: list[Reckoned]) -> str:
    parts = []
    for name in ("reckoned", "steadied", "undrifted", "formula"):
        errors = np.array([getattr(one, name) for one in flown])
        known = errors[np.isfinite(errors)]
        said = "    -      -      -"
        if len(known):
            said = f"{np.median(known):5.1f} {np.percentile(known, 95.0):6.1f} {known.max():6.1f}"
        parts.append(f"{name} {said} ({len(known)}/{len(errors)})")
    return "   ".join(parts)


if __name__ == "__main__":
    typer.run(main)
