"""Flight records as CSV: our own columns, and those of Airdata and of DJI's Flight Reader where they mean the same."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from mission.errors import LogError
from mission.logs.pose_log import PoseLog
from mission.logs.series import from_euler, pose_noise, positions, utc_at_zero
from mission.records import Datum

FEET_M: Final = 0.3048

# Our name: names in other programs' files, each with what turns its number into ours.
_COLUMNS: Final[Mapping[str, Mapping[str, float]]] = {
    "t_s": {"time(millisecond)": 1e-3, "osd.flytime [s]": 1.0},
    "time_utc": {"datetime(utc)": 1.0},
    "lat_deg": {"latitude": 1.0, "osd.latitude": 1.0},
    "lon_deg": {"longitude": 1.0, "osd.longitude": 1.0},
    "amsl_m": {"altitude_above_sealevel(feet)": FEET_M, "osd.altitude [m]": 1.0, "osd.altitude [ft]": FEET_M},
    "ellipsoid_m": {},
    "height_m": {"height_above_takeoff(feet)": FEET_M, "osd.height [m]": 1.0, "osd.height [ft]": FEET_M},
    "roll_deg": {"roll(degrees)": 1.0, "osd.roll": 1.0},
    "pitch_deg": {"pitch(degrees)": 1.0, "osd.pitch": 1.0},
    "yaw_deg": {"compass_heading(degrees)": 1.0, "osd.yaw": 1.0, "osd.yaw [360]": 1.0},
    "gimbal_roll_deg": {"gimbal_roll(degrees)": 1.0, "gimbal.roll": 1.0},
    "gimbal_pitch_deg": {"gimbal_pitch(degrees)": 1.0, "gimbal.pitch": 1.0},
    "gimbal_yaw_deg": {"gimbal_heading(degrees)": 1.0, "gimbal.yaw": 1.0, "gimbal.yaw [360]": 1.0},
    "velocity_east_m_s": {},
    "velocity_north_m_s": {},
    "velocity_up_m_s": {},
    "accuracy_m": {},
}
_MOST_ROWS: Final = 5_000_000


def read_pose_csv(path: Path) -> PoseLog:
    """The flight in a CSV file with a head line.

    Our columns: `t_s` (seconds) or `time_utc` (ISO 8601), `lat_deg`, `lon_deg`, `amsl_m` or `ellipsoid_m` or `height_m`
    (above take-off); `roll_deg`, `pitch_deg`, `yaw_deg` of the aircraft and `gimbal_roll_deg`, `gimbal_pitch_deg`,
    `gimbal_yaw_deg` of the camera (from the horizon and from true north); `velocity_east_m_s` and so on, `accuracy_m`.

    Raises:
        LogError: columns are missing, or it holds no flight.
        OSError: it cannot be read.
    """
    rows: dict[str, list[float]] = {name: [] for name in _COLUMNS}
    try:
        with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
            reader = csv.reader(file)
            head = next(reader, [])
            places = _places(head)
            _check(places, path)
            for number, line in enumerate(reader):
                if number >= _MOST_ROWS:
                    raise LogError(f"{path.name} has more than {_MOST_ROWS} lines", "Cut it into flights.")
                for name, column in rows.items():
                    column.append(_cell(line, places.get(name), name))
    except csv.Error as error:
        raise LogError(f"{path.name} is no CSV file ({error})", "Check the file.") from error
    timed = "t_s" in places
    utc = rows["time_utc"]
    first = next((value for value in utc if math.isfinite(value)), None)
    t_s = rows["t_s"] if timed else [value - (first or 0.0) for value in utc]
    datum: Datum = "ellipsoid" if "ellipsoid_m" in places else "amsl" if "amsl_m" in places else "home"
    up = rows[{"ellipsoid": "ellipsoid_m", "amsl": "amsl_m", "home": "height_m"}[datum]]
    velocity = [rows[f"velocity_{axis}_m_s"] for axis in ("east", "north", "up")]
    told = all(f"velocity_{axis}_m_s" in places for axis in ("east", "north", "up"))
    speed = list(zip(*velocity, strict=True)) if told else None
    origin, series = positions(t_s, list(zip(rows["lat_deg"], rows["lon_deg"], up, strict=True)), speed, datum)
    aircraft = from_euler(t_s, list(zip(rows["roll_deg"], rows["pitch_deg"], rows["yaw_deg"], strict=True)))
    roll = [0.0 if "gimbal_roll_deg" not in places else value for value in rows["gimbal_roll_deg"]]
    gimbal = from_euler(t_s, list(zip(roll, rows["gimbal_pitch_deg"], rows["gimbal_yaw_deg"], strict=True)))
    good = [value for value in rows["accuracy_m"] if math.isfinite(value) and value > 0.0]
    accuracy = sorted(good)[len(good) // 2] if good else None
    pairs = [(t, value) for t, value in zip(t_s, utc, strict=True) if math.isfinite(t) and math.isfinite(value)]
    levels = [a - h for a, h in zip(up, rows["height_m"], strict=True) if math.isfinite(a - h)]
    return PoseLog(
        "csv",
        "vehicle",
        origin,
        series,
        aircraft,
        gimbal,
        pose_noise(accuracy, gimbal or aircraft, gimbal=gimbal is not None),
        utc_at_zero_s=utc_at_zero(pairs),
        accuracy_m=accuracy,
        take_off_up_m=sorted(levels)[len(levels) // 2] - origin.alt_m if levels else None,
    )


def _places(head: list[str]) -> dict[str, tuple[int, float]]:
    """Column and factor of each of our names that the head line has."""
    found: dict[str, tuple[int, float]] = {}
    names = [name.strip().lower() for name in head]
    for ours, others in _COLUMNS.items():
        for name, factor in {ours: 1.0, **others}.items():
            if name in names and ours not in found:
                found[ours] = names.index(name), factor
    return found


def _check(places: Mapping[str, object], path: Path) -> None:
    missing = [name for name in ("lat_deg", "lon_deg") if name not in places]
    if "t_s" not in places and "time_utc" not in places:
        missing.append("t_s (or time_utc)")
    if not any(name in places for name in ("amsl_m", "ellipsoid_m", "height_m")):
        missing.append("amsl_m (or ellipsoid_m, height_m)")
    if missing:
        raise LogError(
            f"{path.name} has no column {', '.join(missing)}", "Name the columns as docs/recorded-flights.md."
        )


def _cell(line: list[str], place: tuple[int, float] | None, name: str) -> float:
    if place is None or place[0] >= len(line):
        return math.nan
    text = line[place[0]].strip()
    if name == "time_utc":
        try:
            when = datetime.fromisoformat(text.replace("Z", "+00:00"))
            return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError, OSError):
            return math.nan
    try:
        return float(text) * place[1]
    except ValueError:
        return math.nan
