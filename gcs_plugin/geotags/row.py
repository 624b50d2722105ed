"""A geotag read back from the cells of its row, each of which somebody may have edited by hand."""

from __future__ import annotations

import base64
import binascii
import json
import math
from collections.abc import Mapping
from datetime import datetime
from typing import get_args

from gcs_plugin.geotags.geotag import Geotag, Provenance, row
from mission.geodesy import Geodetic
from mission.records import Datum


def geotag_of_row(cells: Mapping[str, object], number: object) -> Geotag:
    """The geotag that `gcs_plugin.geotags.geotag.row` made these cells of.

    Args:
        cells: by column name.
        number: of the geotag in its log.

    Raises:
        ValueError: a cell is missing, of another type or no number; the message names the column.
    """
    velocity = [_number(cells, f"velocity_{axis}_m_s", or_none=True) for axis in ("east", "north", "up")]
    east, north, up = velocity
    time_utc = datetime.fromisoformat(_text(cells, "time_utc"))
    if time_utc.tzinfo is None:
        raise ValueError("time_utc has no time zone")
    place = _place(cells, "")
    if place is None:
        raise ValueError("it has no place")
    picture = cells.get("picture") or b""
    if not isinstance(picture, bytes):
        raise ValueError("picture is no picture")
    return Geotag(
        id=_text(cells, "id"),
        time_utc=time_utc,
        place=place,
        covariance=_covariance(_json(cells, "covariance_enu")),
        velocity_enu_m_s=None if east is None or north is None or up is None else (east, north, up),
        method=_text(cells, "method"),
        model=_text(cells, "model"),
        depth_m=_sure(cells, "depth_m"),
        sightings=_whole(cells, "sightings"),
        rejected=_whole(cells, "rejected"),
        chi2=_number(cells, "chi2", or_none=True),
        dof=None if cells.get("dof") is None else _whole(cells, "dof"),
        drone=_place(cells, "drone_"),
        provenance=Provenance(
            **{
                name: _text(cells, name)
                for name in ("software", "flight_id", "sightings_file", "video", "link", "choice", "noise_preset")
            }
        ),
        geoid_separation_m=_number(cells, "geoid_separation_m", or_none=True),
        notes=_notes(_json(cells, "notes")),
        picture=picture,
        number=_whole({"fid": number}, "fid"),
    )


def to_json(geotag: Geotag) -> bytes:
    """The whole row as JSON, picture and number included."""
    cells = {**row(geotag), "picture": base64.b64encode(geotag.picture).decode("ascii")}
    return f"{json.dumps({'number': geotag.number, **cells}, indent=1)}\n".encode()


def from_json(content: bytes) -> Geotag:
    """The geotag that `to_json` wrote.

    Raises:
        ValueError: it is none.
    """
    try:
        cells = json.loads(content)
    except RecursionError as error:
        raise ValueError("brackets within thousands of brackets") from error
    if not isinstance(cells, dict):
        raise ValueError("it is no row")
    try:
        picture = base64.b64decode(_text(cells, "picture"), validate=True)
    except binascii.Error as error:
        raise ValueError("picture is no picture") from error
    return geotag_of_row({**cells, "picture": picture}, cells.get("number"))


def _text(cells: Mapping[str, object], name: str) -> str:
    cell = cells.get(name)
    if not isinstance(cell, str):
        raise ValueError(f"{name} is no text")
    return cell


def _number(cells: Mapping[str, object], name: str, *, or_none: bool = False) -> float | None:
    cell = cells.get(name)
    if cell is None and or_none:
        return None
    if isinstance(cell, bool) or not isinstance(cell, int | float):
        raise ValueError(f"{name} is no number")
    try:
        number = float(cell)
    except OverflowError as error:  # hundreds of digits
        raise ValueError(f"{name} is no number") from error
    if not math.isfinite(number):
        raise ValueError(f"{name} is no number")
    return number


def _sure(cells: Mapping[str, object], name: str) -> float:
    number = _number(cells, name)
    if number is None:
        raise ValueError(f"{name} is no number")
    return number


def _whole(cells: Mapping[str, object], name: str) -> int:
    cell = cells.get(name)
    if isinstance(cell, bool) or not isinstance(cell, int) or not -(2**63) <= cell < 2**63:
        raise ValueError(f"{name} is no whole number")
    return cell


def _place(cells: Mapping[str, object], prefix: str) -> Geodetic | None:
    if cells.get(f"{prefix}lat_deg") is None:
        return None
    datum = cells.get(f"{prefix}alt_datum")
    for known in get_args(Datum):
        if datum == known:
            lat_deg, lon_deg = _sure(cells, f"{prefix}lat_deg"), _sure(cells, f"{prefix}lon_deg")
            if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
                raise ValueError(f"{prefix}lat_deg, {prefix}lon_deg is no place on earth")
            return Geodetic(lat_deg, lon_deg, _sure(cells, f"{prefix}alt_m"), known)
    raise ValueError(f"unknown datum {datum!r}")


def _json(cells: Mapping[str, object], name: str) -> object:
    try:
        return json.loads(_text(cells, name))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{name} cannot be read: {error}") from error


def _covariance(rows: object) -> tuple[tuple[float, float, float, float, float, float], ...]:
    if not isinstance(rows, list) or len(rows) != 6:
        raise ValueError("covariance_enu is not 6 x 6")
    found = []
    for each in rows:
        if not isinstance(each, list) or len(each) != 6:
            raise ValueError("covariance_enu is not 6 x 6")
        a, b, c, d, e, f = (_sure({"covariance_enu": cell}, "covariance_enu") for cell in each)
        found.append((a, b, c, d, e, f))
    if any(found[i][i] < 0.0 for i in range(6)):
        raise ValueError("covariance_enu is impossible")
    return tuple(found)


def _notes(notes: object) -> tuple[str, ...]:
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise ValueError("notes are no texts")
    return tuple(notes)
