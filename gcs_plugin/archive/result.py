"""A recorded flight's results as files, the same bytes for the same inputs.

RESULT/
    result.json     how video and log were put together, who was located, who was not and why
    targets.gpkg    layers targets, ellipses (95 %), rays (who was only seen), paths (of the camera)
    target-1.jpg    the person, from the sharpest view
    sightings.jsonl what the places were estimated from (`sidestep estimate` computes them again)
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from gcs_plugin.archive.layers import Feature, Layer, write_layers
from gcs_plugin.durable import write_whole
from gcs_plugin.geotags.siting import sited
from mission.errors import SidestepError
from mission.estimate.sightings_file import flight_lines
from mission.geodesy import ce90_m, enu_to_geodetic, error_ellipse, le90_m
from mission.logs import PoseLog
from mission.observation.reprocess import Ray, Reprocessed, Target
from mission.records import GeodeticOrigin, Matrix, Vector

RESULT: Final = "result.json"
GEOPACKAGE: Final = "targets.gpkg"
FORMAT, VERSION = "sidestep-archive-result", 1
_NO_DATE = "1970-01-01T00:00:00.000Z"
_PATH_STEP_S = 0.5


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a result was made from."""

    flight: str
    """Name, for people."""
    video: str
    log: str
    key: str
    """Hash of the content of both, of the settings and of the program's version."""
    software: str


def write_result(folder: Path, inputs: Inputs, found: Reprocessed, log: PoseLog) -> None:
    """Write all files of a flight into a folder that exists.

    Raises:
        AnswerError: they cannot be written.
    """
    pose_at = log.pose_at()
    # On the earth a person is as uncertain as the aircraft that saw them, besides.
    on_earth = [replace(one, estimate=sited(one.estimate, one.flight, pose_at).estimate) for one in found.targets]
    found = replace(found, targets=tuple(on_earth))
    targets = [_target(one, log, found.time.offset_s) for one in found.targets]
    rays = [_ray(one, log, found.time.offset_s) for one in found.rays]
    for one in found.targets:
        if one.picture:
            write_whole(folder / _picture(one), one.picture)
    lines = [line for one in found.targets for line in flight_lines(one.flight)]
    write_whole(folder / "sightings.jsonl", "".join(f"{line}\n" for line in lines).encode())
    layers = flight_layers(inputs.flight, found, log, targets, rays)
    write_layers(folder / GEOPACKAGE, layers, utc_text(log, log.first_s) or _NO_DATE)
    time = found.time
    lens = found.camera.intrinsics
    _write_json(
        folder,
        {
            **_head(inputs),
            "error": None,
            "time": {
                "offset_s": time.offset_s,
                "sigma_s": time.sigma_s,
                "measured": time.measured,
                "correlation": _finite(time.likeness),
                "next_best": _finite(time.runner_up),
                "how": time.how,
            },
            "lens": {
                "hfov_deg": math.degrees(2.0 * math.atan(lens.width_px / 2.0 / lens.fx)),
                "fx_px": lens.fx,
                "focal_sigma": found.camera.focal_sigma,
                "how": found.lens_note,
            },
            "log_kind": log.kind,
            "video_s": found.survey.last_s,
            "pictures": found.survey.pictures,
            "looks": len(found.survey.looks),
            "notes": [*found.notes, *log.notes],
            "targets": targets,
            "not_located": rays,
        },
    )


def write_refusal(folder: Path, inputs: Inputs, error: SidestepError) -> None:
    """Write why a flight gave nothing at all.

    Raises:
        AnswerError: it cannot be written.
    """
    _write_json(
        folder, {**_head(inputs), "error": error.cause, "remedy": error.remedy, "targets": [], "not_located": []}
    )


def _head(inputs: Inputs) -> dict[str, object]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "flight": inputs.flight,
        "video": inputs.video,
        "log": inputs.log,
        "key": inputs.key,
        "software": inputs.software,
    }


def _write_json(folder: Path, record: dict[str, object]) -> None:
    text = json.dumps(record, indent=2, allow_nan=False, ensure_ascii=False)
    write_whole(folder / RESULT, f"{text}\n".encode())


def utc_text(log: PoseLog, t_s: float) -> str | None:
    """UTC of a log time, ISO 8601 with milliseconds; None where the log does not tell it."""
    if log.utc_at_zero_s is None:
        return None
    when = datetime.fromtimestamp(round(log.utc_at_zero_s + t_s, 3), UTC)
    return when.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _picture(one: Target) -> str:
    return f"target-{one.candidate.number}.jpg"


def _target(one: Target, log: PoseLog, offset_s: float) -> dict[str, object]:
    answer, covariance = one.estimate, one.estimate.covariance
    assert covariance is not None
    place = enu_to_geodetic(answer.position_enu_m, log.origin)
    ellipse = error_ellipse(covariance[:2, :2])
    velocity = answer.velocity_enu_m_s
    return {
        "number": one.candidate.number,
        "time_utc": utc_text(log, answer.t_s),
        "log_s": answer.t_s,
        "video_s": answer.t_s + offset_s,
        "seen_video_s": [one.candidate.first_s, one.candidate.last_s],
        "measured_video_s": [one.part.from_s, one.part.to_s],
        "lat_deg": place.lat_deg,
        "lon_deg": place.lon_deg,
        "alt_m": place.alt_m,
        "alt_datum": place.datum,
        "ce90_m": ce90_m(covariance[:2, :2]),
        "le90_m": le90_m(float(covariance[2, 2])),
        "ellipse95": {
            "semi_major_m": ellipse.semi_major_m,
            "semi_minor_m": ellipse.semi_minor_m,
            "azimuth_deg": math.degrees(ellipse.azimuth_rad),
        },
        "velocity_enu_m_s": None if velocity is None else velocity.tolist(),
        "covariance_enu": covariance.tolist(),
        "distance_m": answer.depth_m,
        "relative_sigma": one.relative_sigma,
        "lateral_share": one.part.lateral,
        "sightings": answer.sightings,
        "rejected": answer.rejected,
        "model": answer.model,
        "notes": list(answer.notes),
        "picture": _picture(one) if one.picture else None,
    }


def _ray(one: Ray, log: PoseLog, offset_s: float) -> dict[str, object]:
    camera = enu_to_geodetic(one.camera_enu_m, log.origin)
    ground = None if one.ground_enu_m is None else enu_to_geodetic(one.ground_enu_m, log.origin)
    return {
        "number": one.candidate.number,
        "why": one.why,
        "time_utc": utc_text(log, one.t_s),
        "video_s": one.t_s + offset_s,
        "seen_video_s": [one.candidate.first_s, one.candidate.last_s],
        "camera": {"lat_deg": camera.lat_deg, "lon_deg": camera.lon_deg, "alt_m": camera.alt_m, "datum": camera.datum},
        "azimuth_deg": math.degrees(one.azimuth_rad),
        "elevation_deg": math.degrees(one.elevation_rad),
        "single_ray_on_level_ground": None
        if ground is None or one.ground_sigma_m is None
        else {
            "lat_deg": ground.lat_deg,
            "lon_deg": ground.lon_deg,
            "sigma_along_m": one.ground_sigma_m[0],
            "sigma_across_m": one.ground_sigma_m[1],
            "assumes": "level ground at the height of the take-off point",
        },
    }


TARGET_COLUMNS: Final = (
    ("flight", "TEXT NOT NULL"),
    ("number", "INTEGER NOT NULL"),
    ("time_utc", "DATETIME"),
    ("video_s", "DOUBLE NOT NULL"),
    ("lat_deg", "DOUBLE NOT NULL"),
    ("lon_deg", "DOUBLE NOT NULL"),
    ("alt_m", "DOUBLE NOT NULL"),
    ("alt_datum", "TEXT NOT NULL"),
    ("ce90_m", "DOUBLE NOT NULL"),
    ("le90_m", "DOUBLE NOT NULL"),
    ("distance_m", "DOUBLE NOT NULL"),
    ("relative_sigma", "DOUBLE NOT NULL"),
    ("velocity_east_m_s", "DOUBLE"),
    ("velocity_north_m_s", "DOUBLE"),
    ("model", "TEXT NOT NULL"),
    ("notes", "TEXT NOT NULL"),
)
RAY_COLUMNS: Final = (
    ("flight", "TEXT NOT NULL"),
    ("number", "INTEGER NOT NULL"),
    ("time_utc", "DATETIME"),
    ("video_s", "DOUBLE NOT NULL"),
    ("azimuth_deg", "DOUBLE NOT NULL"),
    ("elevation_deg", "DOUBLE NOT NULL"),
    ("sigma_along_m", "DOUBLE"),
    ("sigma_across_m", "DOUBLE"),
    ("why", "TEXT NOT NULL"),
)
ELLIPSE_COLUMNS: Final = (("flight", "TEXT NOT NULL"), ("number", "INTEGER NOT NULL"), ("ce90_m", "DOUBLE NOT NULL"))
PATH_COLUMNS: Final = (("flight", "TEXT NOT NULL"), ("number", "INTEGER NOT NULL"))
DESCRIPTIONS: Final = {
    "targets": "people who were located",
    "ellipses": "where each of them is with 95 % probability",
    "rays": "people who were only seen: from the camera to level ground at the take-off point's height, one ray each",
    "paths": "the camera's way while each was measured",
}


def flight_layers(
    flight: str,
    found: Reprocessed,
    log: PoseLog,
    targets: Sequence[dict[str, object]],
    rays: Sequence[dict[str, object]],
) -> list[Layer]:
    """The layers of one flight.

    Args:
        flight: its name.
        found: what came of it.
        log: its log, for the local frame.
        targets: as they stand in result.json.
        rays: likewise.
    """
    points, ellipses, lines, paths = [], [], [], []
    for one, told in zip(found.targets, targets, strict=True):
        velocity = one.estimate.velocity_enu_m_s
        cells = {
            **told,
            "flight": flight,
            "velocity_east_m_s": None if velocity is None else float(velocity[0]),
            "velocity_north_m_s": None if velocity is None else float(velocity[1]),
            "notes": json.dumps(told["notes"], ensure_ascii=False),
        }
        place = enu_to_geodetic(one.estimate.position_enu_m, log.origin)
        height = place.alt_m if place.datum == "ellipsoid" else None
        points.append(Feature(((place.lon_deg, place.lat_deg),), _cells(cells, TARGET_COLUMNS), height))
        covariance = one.estimate.covariance
        assert covariance is not None
        ring = error_ellipse(covariance[:2, :2]).outline(48) + one.estimate.position_enu_m[:2]
        ellipses.append(Feature(_corners(ring, log.origin), _cells(cells, ELLIPSE_COLUMNS)))
        way = one.camera_path[:: max(1, round(_PATH_STEP_S / _step_s(one.camera_path)))]
        if len(way) > 1:
            paths.append(Feature(_corners(way[:, 1:3], log.origin), _cells(cells, PATH_COLUMNS)))
    for ray, told in zip(found.rays, rays, strict=True):
        if ray.ground_enu_m is not None and ray.ground_sigma_m is not None:
            cells = {**told, "flight": flight}
            cells["sigma_along_m"], cells["sigma_across_m"] = ray.ground_sigma_m
            ends: Vector = np.array([ray.camera_enu_m[:2], ray.ground_enu_m[:2]])
            lines.append(Feature(_corners(ends, log.origin), _cells(cells, RAY_COLUMNS)))
    return [
        Layer("targets", DESCRIPTIONS["targets"], "POINT", TARGET_COLUMNS, points),
        Layer("ellipses", DESCRIPTIONS["ellipses"], "POLYGON", ELLIPSE_COLUMNS, ellipses),
        Layer("rays", DESCRIPTIONS["rays"], "LINESTRING", RAY_COLUMNS, lines),
        Layer("paths", DESCRIPTIONS["paths"], "LINESTRING", PATH_COLUMNS, paths),
    ]


def _cells(told: dict[str, object], columns: Sequence[tuple[str, str]]) -> tuple[str | float | int | None, ...]:
    cells = []
    for name, _ in columns:
        value = told[name]
        if value is not None and not isinstance(value, (str, float, int)):
            raise TypeError(f"{name} is no cell of a table")
        cells.append(value)
    return tuple(cells)


def _corners(east_north_m: Matrix, origin: GeodeticOrigin) -> tuple[tuple[float, float], ...]:
    places = [enu_to_geodetic(np.array([east, north, 0.0]), origin) for east, north in east_north_m.tolist()]
    return tuple((place.lon_deg, place.lat_deg) for place in places)


def _step_s(path: Matrix) -> float:
    return float(np.median(np.diff(path[:, 0]))) if len(path) > 1 else _PATH_STEP_S


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
