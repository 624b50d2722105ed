"""How good answers to the benchmark are: people found, errors, and whether the stated ellipses hold the truth.

Answers are a GeoJSON FeatureCollection of points with the properties `flight` (the file's name without suffix),
`video_s` (time in the video for which the point holds) and `ce90_m`; `sidestep archive merge` writes it.
The aircraft's own place is wrong by metres, which no program can know: as `beside_m`, an answer is also compared with
where the person was as seen from where the aircraft was reported to be.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from mission.errors import InputError
from mission.geodesy import geodetic_to_enu
from mission.records import GeodeticOrigin
from sitl.evaluation.archive.flights import TRUTH

_NEAR_S: Final = 0.5


@dataclass(frozen=True, slots=True)
class Scored:
    """The best answer to one flight."""

    flight: str
    answered: bool
    error_m: float = math.nan
    """On the earth, horizontal."""
    beside_m: float = math.nan
    """Relative to the aircraft's reported place."""
    ce90_m: float = math.nan
    spare: int = 0
    """Answers beside the best one: nobody else is there."""

    @property
    def inside(self) -> bool:
        """Whether the truth is inside the stated circle."""
        return self.error_m <= self.ce90_m


def score(out: Path, answers: Path) -> list[Scored]:
    """Score a program's answers.

    Args:
        out: folder of the benchmark.
        answers: GeoJSON.

    Raises:
        InputError: there are no flights, or the answers cannot be read.
    """
    by_flight = _answers(answers)
    truths = sorted((out / TRUTH).glob("*.truth.json"))
    if not truths:
        raise InputError(f"there are no flights in {out}", "Make them first.")
    scored = []
    for path in truths:
        name = path.name.removesuffix(".truth.json")
        scored.append(_scored(name, json.loads(path.read_text(encoding="utf-8")), by_flight.get(name, [])))
    return scored


def table(scored: list[Scored]) -> str:
    """The figures, as lines."""
    answered = [one for one in scored if one.answered]
    lines = [f"{len(answered)} of {len(scored)} people located, {sum(one.spare for one in scored)} answers too many"]
    if answered:
        for what, values in (
            ("beside the aircraft's reported place", [one.beside_m for one in answered]),
            ("on the earth", [one.error_m for one in answered]),
        ):
            median, most = np.percentile(values, [50, 90]).tolist()
            lines.append(f"error {what}: median {median:.2f} m, 90 % below {most:.2f} m")
        inside = sum(one.inside for one in answered)
        lines.append(f"truth inside the stated CE90 in {inside} of {len(answered)}")
    return "\n".join(lines)


def _answers(path: Path) -> dict[str, list[tuple[float, float, float, float]]]:
    """By flight: video time, latitude, longitude, CE90."""
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    try:
        for feature in json.loads(path.read_text(encoding="utf-8"))["features"]:
            told = feature["properties"]
            lon, lat = feature["geometry"]["coordinates"][:2]
            row = float(told["video_s"]), float(lat), float(lon), float(told["ce90_m"])
            found.setdefault(Path(str(told["flight"])).name, []).append(row)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path} is no GeoJSON of answers ({error})", "See sitl/evaluation/archive/score.py."
        ) from error
    return found


def _scored(name: str, truth: Mapping[str, Any], answers: list[tuple[float, float, float, float]]) -> Scored:
    origin = GeodeticOrigin(*truth["origin"])
    best: Scored | None = None
    for video_s, lat, lon, ce90_m in answers:
        row = min(truth["rows"], key=lambda one: abs(one["video_s"] - video_s))
        if abs(row["video_s"] - video_s) > _NEAR_S or not abs(lat) <= 90.0:
            continue
        off = (geodetic_to_enu(lat, lon, origin.alt_m, origin) - np.array(row["person_enu_m"]))[:2]
        shift = np.zeros(2) if row["reported_less_true_m"] is None else np.array(row["reported_less_true_m"])[:2]
        error, beside = float(np.linalg.norm(off)), float(np.linalg.norm(off - shift))
        if best is None or beside < best.beside_m:
            best = Scored(name, True, error, beside, ce90_m, len(answers) - 1)
    return best or Scored(name, False, spare=len(answers))
