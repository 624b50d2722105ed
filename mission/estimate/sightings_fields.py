"""The fields of a sightings file: JSON objects to records, checked one by one (format `sidestep-sightings`, version 1).

Nothing is guessed: a field that is missing, null, of a wrong type, not finite, beyond `LARGEST` or out of its range
raises `FieldError` with the field's name. The exceptions are the format's own: `noise` and `prior` fields have
documented defaults, a sighting's `pixel_sigma_px` and `size_sigma` are optional, `height_px` may be null, and unknown
fields are ignored.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any, get_args

from mission.camera.model import MOST_BEND, largest_bend
from mission.records import (
    CameraIntrinsics,
    ClassHeight,
    Datum,
    FlightSightings,
    GeodeticOrigin,
    NoiseModel,
    Sighting,
    TargetPrior,
)

FORMAT = "sidestep-sightings"
VERSION = 1

_UNIT_TOLERANCE = 1e-3
"""How far a quaternion's norm may be from one: four written decimals, no more."""

_EXACT = 1e-12

LARGEST = 1e12
"""Of any number: no unit of the format makes sense of more."""
SMALLEST = 1e-12
"""Of a number that must not be negative, where it is not zero."""

_DATUMS: Mapping[str, Datum] = {"ellipsoid": "ellipsoid", "amsl": "amsl", "home": "home"}


class FieldError(ValueError):
    """A field of a sightings file does not follow the format; the message names the field and what is wrong."""


def parse_header(record: Mapping[str, object]) -> FlightSightings:
    """A header line as a flight without sightings.

    Args:
        record: the decoded JSON object.

    Raises:
        FieldError: a field is missing or wrong.
    """
    if record.get("format") != FORMAT:
        raise FieldError(f'"format" is not "{FORMAT}"')
    version = _number(record, "version")
    if version != VERSION:
        raise FieldError(f'"version" is {version:g}, and only version {VERSION} can be read')
    return FlightSightings(
        id=flight_id(record),
        origin=_origin(_object(record, "origin")),
        camera=_camera(_object(record, "camera")),
        sightings=(),
        noise=_noise(_object(record, "noise") if "noise" in record else {}),
        prior=_prior(_object(record, "prior") if "prior" in record else {}),
        continues=_text(record, "continues") if record.get("continues") is not None else None,
    )


def flight_id(record: Mapping[str, object]) -> str:
    """The header's `id`.

    Raises:
        FieldError: it is missing or not a text.
    """
    return _text(record, "id")


def parse_sighting(record: Mapping[str, object]) -> Sighting:
    """A sighting line; a quaternion that is not exactly a unit one is normalised.

    Raises:
        FieldError: a field is missing or wrong.
    """
    w, x, y, z = _numbers(record, "world_from_camera_wxyz", 4)
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(norm - 1.0) <= _UNIT_TOLERANCE:
        raise FieldError(f'"world_from_camera_wxyz" is not a unit quaternion (its norm is {norm:.6g})')
    if abs(norm - 1.0) < _EXACT:
        norm = 1.0  # so that a flight that was written reads back bit for bit
    east, north, up = _numbers(record, "position_enu_m", 3)
    u, v = _numbers(record, "pixel", 2)
    return Sighting(
        t_s=_number(record, "t_s"),
        position_enu_m=(east, north, up),
        world_from_camera_wxyz=(w / norm, x / norm, y / norm, z / norm),
        pixel=(u, v),
        height_px=None if _present(record, "height_px", nullable=True) is None else _positive(record, "height_px"),
        pixel_sigma_px=_not_negative(record, "pixel_sigma_px") if "pixel_sigma_px" in record else None,
        size_sigma=_not_negative(record, "size_sigma") if "size_sigma" in record else None,
    )


def _origin(record: Mapping[str, object]) -> GeodeticOrigin:
    lat, lon = _number(record, "lat_deg"), _number(record, "lon_deg")
    if not -90.0 <= lat <= 90.0:
        raise FieldError(f'"lat_deg" is {lat:g}, outside -90 to 90')
    if not -180.0 <= lon <= 180.0:
        raise FieldError(f'"lon_deg" is {lon:g}, outside -180 to 180')
    datum = _present(record, "datum")
    if not isinstance(datum, str) or datum not in _DATUMS:
        raise FieldError('"datum" is none of ' + ", ".join(f'"{name}"' for name in _DATUMS))
    return GeodeticOrigin(lat, lon, _number(record, "alt_m"), _DATUMS[datum])


def _camera(record: Mapping[str, object]) -> CameraIntrinsics:
    width, height = _positive(record, "width_px"), _positive(record, "height_px")
    for name, value in (("width_px", width), ("height_px", height)):
        if value != int(value):
            raise FieldError(f'"{name}" is not a whole number')
    k1, k2, p1, p2, k3 = _numbers(record, "distortion", 5)
    lens = CameraIntrinsics(
        width_px=int(width),
        height_px=int(height),
        fx=_positive(record, "fx"),
        fy=_positive(record, "fy"),
        cx=_number(record, "cx"),
        cy=_number(record, "cy"),
        distortion=(k1, k2, p1, p2, k3),
    )
    if not largest_bend(lens) <= MOST_BEND:
        raise FieldError('"distortion" bends the picture as no lens does')
    return lens


def _noise(record: Mapping[str, object]) -> NoiseModel:
    return NoiseModel(**{f.name: _not_negative(record, f.name) for f in fields(NoiseModel) if f.name in record})


def _prior(record: Mapping[str, object]) -> TargetPrior:
    for value, sigma in (("ground_up_m", "ground_sigma_m"), ("height_m", "height_sigma_m")):
        if (value in record) != (sigma in record):
            raise FieldError(f'"{value}" and "{sigma}" go together, and one of them is missing')
    checks: dict[str, Callable[[Mapping[str, object], str], Any]] = {
        "ground_up_m": _number,
        "centre_above_ground_m": _number,
        "height_m": _positive,
        "class_height": _class_height,
    }
    given = [f.name for f in fields(TargetPrior) if f.name in record]
    return replace(TargetPrior(), **{name: checks.get(name, _not_negative)(record, name) for name in given})


def _class_height(record: Mapping[str, object], name: str) -> str:
    value = _text(record, name)
    if value not in get_args(ClassHeight):
        raise FieldError(f'"{name}" is none of {", ".join(get_args(ClassHeight))}')
    return value


def _text(record: Mapping[str, object], name: str) -> str:
    value = _present(record, name)
    if not isinstance(value, str):
        raise FieldError(f'"{name}" is not a text')
    return value


def _present(record: Mapping[str, object], name: str, *, nullable: bool = False) -> object:
    if name not in record:
        raise FieldError(f'"{name}" is missing')
    value = record[name]
    if value is None and not nullable:
        raise FieldError(f'"{name}" is null')
    return value


def _object(record: Mapping[str, object], name: str) -> Mapping[str, object]:
    value = _present(record, name)
    if not isinstance(value, dict):
        raise FieldError(f'"{name}" is not an object')
    return value


def _finite(value: object, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FieldError(f'"{name}" is not a number')
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise FieldError(f'"{name}" is not finite')
    if abs(number) > LARGEST:
        raise FieldError(f'"{name}" is {number:g}, which is beyond {LARGEST:g}')
    return number


def _number(record: Mapping[str, object], name: str) -> float:
    return _finite(_present(record, name), name)


def _positive(record: Mapping[str, object], name: str) -> float:
    value = _number(record, name)
    if not value > 0.0:
        raise FieldError(f'"{name}" is {value:g} and has to be above 0')
    return _not_negative(record, name)


def _not_negative(record: Mapping[str, object], name: str) -> float:
    value = _number(record, name)
    if value < 0.0:
        raise FieldError(f'"{name}" is {value:g} and cannot be below 0')
    if 0.0 < value < SMALLEST:
        raise FieldError(f'"{name}" is {value:g}, which is below {SMALLEST:g}')
    return value


def _numbers(record: Mapping[str, object], name: str, length: int) -> list[float]:
    value = _present(record, name)
    if not isinstance(value, list):
        raise FieldError(f'"{name}" is not a list of {length} numbers')
    if len(value) != length:
        raise FieldError(f'"{name}" has {len(value)} numbers, not {length}')
    return [_finite(item, name) for item in value]
