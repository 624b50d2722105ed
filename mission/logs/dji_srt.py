"""DJI's subtitle files (SRT): one cue a frame, or a second, with position, heights, and on some models the attitude.

The families differ in spelling, not in meaning: bracketed `[latitude: 59.3]` (also inside <font>), and functions
`GPS(39.9,116.3,69.8)` with HOME, BAROMETER, `F.PRY (pitch, roll, yaw)` of the aircraft and `G.PRY` of the gimbal. A
function's position is latitude first on some models and longitude first on others: HOME and the ranges tell, else it
has to be said.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, tzinfo
from pathlib import Path
from typing import Final, Literal

import numpy as np

from mission.errors import LogError
from mission.logs.pose_log import Attitudes, PoseLog
from mission.logs.series import from_euler, pose_noise, positions, slopes
from mission.records import Vector

AxisOrder = Literal["auto", "lat-lon", "lon-lat"]
"""Which comes first in GPS(...)."""

_FILM_WIDTH_MM: Final = 36.0
"""Of the 35 mm film whose focal length is told."""
_TENTHS_MM = 100.0
"""Focal lengths above are ten times the millimetres."""
_WINDOW_S: Final = 0.4
"""Positions are printed at 30 Hz but change at 5 to 10 Hz, rounded to 0.1 m: averaged over this."""
_NUMBER = r"[-+]?\d+(?:\.\d+)?"
_STAMP = r"(\d+):(\d\d):(\d\d)[.,](\d{1,3})"
_TIMES: Final = re.compile(rf"{_STAMP}\s*-->\s*{_STAMP}")
_PAIR: Final = re.compile(rf"\b([A-Za-z_]+)\s*:\s*({_NUMBER})")
_CALL: Final = re.compile(
    rf"\b(GPS|RTK|HOME|F\.PRY|G\.PRY)\s*\(\s*({_NUMBER})[^\d,)-]*,\s*({_NUMBER})[^,)]*(?:,\s*({_NUMBER}))?"
)
_BAROMETER: Final = re.compile(rf"BAROMETER\s*[:(]\s*({_NUMBER})")
_HEIGHT: Final = re.compile(rf"\bH[= ]\s*({_NUMBER})\s*m", re.IGNORECASE)
_WHEN: Final = re.compile(r"(\d{4})[-./](\d{2})[-./](\d{2})\s+(\d{2}):(\d{2}):(\d{2})(?:[.,](\d{1,3}))?")

Three = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class _Cue:
    t_s: float
    pair: tuple[float, float] | None
    """Latitude and longitude, in this order where the names say so."""
    named: bool
    above_sea_m: float | None
    height_m: float | None
    home: tuple[float, float] | None
    aircraft_deg: Three | None
    """Roll, pitch, yaw."""
    gimbal_deg: Three | None
    focal_mm: float | None
    zoom: float | None
    when: datetime | None


def read_dji_srt(path: Path, order: AxisOrder = "auto", zone: tzinfo | None = None) -> PoseLog:
    """The flight in a subtitle file; its time is the video's own.

    Args:
        path: the .SRT file.
        order: of the two numbers in GPS(...), where the model does not name them.
        zone: of the local times in it; without it the flight's UTC is not known.

    Raises:
        LogError: it holds no positions, or their order cannot be told.
        OSError: it cannot be read.
    """
    cues = _cues(_text(path))
    placed = [cue for cue in cues if cue.pair is not None]
    if not placed:
        raise LogError(
            f"{path.name} holds no positions", "Give the SRT of a flight that had a GPS fix, or another log of it."
        )
    swapped = not placed[0].named and _longitude_first(placed, order, path)
    t_s = np.array([cue.t_s for cue in placed])
    place = np.array([cue.pair[::-1] if swapped else cue.pair for cue in placed if cue.pair is not None])
    height, altitude = _column([c.height_m for c in placed]), _column([c.above_sea_m for c in placed])
    take_off = None
    if np.isfinite(height).mean() > 0.5:
        # The height over take-off is smooth to decimetres; the altitude only says where it starts from.
        offset = float(np.nanmedian(altitude - height)) if np.isfinite(altitude - height).any() else 0.0
        level, take_off = height + offset, offset
    else:
        level = altitude
    origin, series = positions(
        t_s, np.column_stack([place, level]), None, "amsl" if np.isfinite(altitude).any() else "home"
    )
    smooth = np.column_stack([_averaged(series.t_s, series.enu_m[:, axis]) for axis in range(3)])
    series = type(series)(series.t_s, smooth, slopes(series.t_s, smooth))
    aircraft, gimbal = _turned(cues, "aircraft_deg"), _turned(cues, "gimbal_deg")
    focal = [cue.focal_mm * (cue.zoom or 1.0) for cue in cues if cue.focal_mm]
    hfov, zoomed = _field_of_view(focal)
    when = next(((cue.t_s, cue.when) for cue in cues if cue.when is not None), None)
    utc = None
    if when is not None and zone is not None:
        utc = when[1].replace(tzinfo=zone).astimezone(UTC).timestamp() - when[0]
    notes = () if aircraft or gimbal else ("this model writes no attitude into its subtitles",)
    return PoseLog(
        "dji-srt",
        "video",
        origin,
        series,
        aircraft,
        gimbal,
        pose_noise(None, gimbal or aircraft, gimbal=gimbal is not None),
        utc_at_zero_s=utc,
        hfov_rad=hfov,
        zoomed=zoomed,
        take_off_up_m=None if take_off is None else take_off - origin.alt_m,
        notes=notes,
    )


def _text(path: Path) -> str:
    raw = path.read_bytes()
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16", "replace")
    return raw.decode("utf-8-sig", "replace")


def _cues(text: str) -> list[_Cue]:
    """Each time line begins a cue that goes on to the next one."""
    begins = list(_TIMES.finditer(text))
    ends = [found.start() for found in begins[1:]] + [len(text)]
    cues = []
    for found, end in zip(begins, ends, strict=True):
        hours, minutes, seconds, milliseconds = found.groups()[:4]
        t_s = 3600.0 * int(hours) + 60.0 * int(minutes) + int(seconds) + 1e-3 * int(milliseconds.ljust(3, "0"))
        cues.append(_cue(t_s, text[found.end() : end]))
    return cues


def _cue(t_s: float, body: str) -> _Cue:
    pairs = {name.lower(): float(value) for name, value in _PAIR.findall(body)}
    calls = {name: (float(a), float(b), float(c) if c else None) for name, a, b, c in _CALL.findall(body)}
    lat, lon = pairs.get("latitude"), pairs.get("longitude", pairs.get("longtitude"))
    named = lat is not None and lon is not None
    gps = calls.get("GPS") or calls.get("RTK")
    pair = (lat, lon) if lat is not None and lon is not None else gps[:2] if gps else None
    if pair is not None and (pair == (0.0, 0.0) or not all(abs(x) <= 180.0 for x in pair)):
        pair = None  # before the first fix
    home = calls.get("HOME")
    barometer, height = _BAROMETER.search(body), _HEIGHT.search(body)
    told = pairs.get("rel_alt")
    if told is None:
        found = height or barometer
        told = float(found.group(1)) if found else None
    above = pairs.get("abs_alt", pairs.get("altitude"))
    focal = pairs.get("focal_len")
    ratio = pairs.get("dzoom_ratio")
    return _Cue(
        t_s,
        pair,
        named,
        above,
        told,
        None if home is None else home[:2],
        _pitch_roll_yaw(calls.get("F.PRY")) or _named(pairs, "drone"),
        _pitch_roll_yaw(calls.get("G.PRY")) or _named(pairs, "gb"),
        None if not focal else focal / 10.0 if focal >= _TENTHS_MM else focal,
        None if not ratio else ratio / 1e4 if ratio >= _TENTHS_MM else ratio,
        _when(body),
    )


def _when(body: str) -> datetime | None:
    """The local time that stands in a cue."""
    found = _WHEN.search(body)
    if found is None:
        return None
    year, month, day, hour, minute, second = (int(part) for part in found.groups()[:6])
    microsecond = 1000 * int((found.group(7) or "0").ljust(3, "0"))
    try:
        return datetime(year, month, day, hour, minute, second, microsecond)
    except ValueError:
        return None


def _pitch_roll_yaw(told: tuple[float, float, float | None] | None) -> Three | None:
    if told is None or told[2] is None:
        return None
    pitch, roll, yaw = told
    assert yaw is not None
    return roll, pitch, yaw


def _named(pairs: dict[str, float], whose: str) -> Three | None:
    names = [f"{whose}_{angle}" for angle in ("roll", "pitch", "yaw")]
    if not all(name in pairs for name in names[1:]):
        return None
    return pairs.get(names[0], 0.0), pairs[names[1]], pairs[names[2]]


def _longitude_first(cues: Sequence[_Cue], order: AxisOrder, path: Path) -> bool:
    """Whether the first number of a pair is the longitude.

    Raises:
        LogError: both orders are possible.
    """
    if order != "auto":
        return order == "lon-lat"
    pairs = np.array([cue.pair for cue in cues])
    home = np.array([cue.home for cue in cues if cue.home is not None]).reshape(-1, 2)
    for told in (pairs, home):
        if len(told) and np.abs(told[:, 0]).max() > 90.0:
            return True
        if len(told) and np.abs(told[:, 1]).max() > 90.0:
            return False
    # G.PRY stands in the subtitles of models that write the longitude first (Phantom 4 Pro and RTK, M30, M350).
    if any(cue.gimbal_deg is not None for cue in cues):
        return True
    if any(cue.home is not None for cue in cues):
        return False
    raise LogError(
        f"{path.name}: which of the two numbers in GPS(...) is the latitude cannot be told",
        "Say it with --gps-order lat-lon or lon-lat.",
    )


def _column(values: Sequence[float | None]) -> Vector:
    return np.array([math.nan if value is None else value for value in values], dtype=np.float64)


def _averaged(t_s: Vector, values: Vector) -> Vector:
    """(n,): over the window around each time, by a straight line, so that a steady motion is not delayed."""
    reach = max(1, round(_WINDOW_S / max(float(np.median(np.diff(t_s))), 1e-3) / 2.0))
    if reach == 1:
        return values
    kernel = np.ones(2 * reach + 1) / (2 * reach + 1)
    before, after = 2.0 * values[0] - values[reach:0:-1], 2.0 * values[-1] - values[-2 : -reach - 2 : -1]
    if len(before) < reach or len(after) < reach:
        return values
    return np.convolve(np.concatenate([before, values, after]), kernel, mode="valid")


def _turned(cues: Sequence[_Cue], which: Literal["aircraft_deg", "gimbal_deg"]) -> Attitudes | None:
    told = [(cue.t_s, getattr(cue, which)) for cue in cues if getattr(cue, which) is not None]
    return from_euler([t_s for t_s, _ in told], [angles for _, angles in told])


def _field_of_view(focal_mm: Sequence[float]) -> tuple[float | None, bool]:
    """Full horizontal angle from the focal length on 35 mm film, and whether it changed."""
    if not focal_mm:
        return None, False
    focal = float(np.median(focal_mm))
    zoomed = max(focal_mm) / min(focal_mm) > 1.01 if min(focal_mm) > 0.0 else True
    return (2.0 * math.atan(_FILM_WIDTH_MM / 2.0 / focal), zoomed) if focal > 0.0 else (None, True)
