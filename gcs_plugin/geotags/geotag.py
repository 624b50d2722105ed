"""The geotag: where a target was and how sure that is, with all that is needed to believe it or to compute it again."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from mission.addresses import shown_address
from mission.errors import AnswerError
from mission.geodesy import ErrorEllipse, Geodetic, altitude_in, ce90_m, enu_to_geodetic, error_ellipse, le90_m
from mission.records import Estimate, GeodeticOrigin, Matrix, Vector

Cell = str | float | int | bytes | None
"""What one column of a table holds."""
Row6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a geotag comes from."""

    software: str
    """Name and version of the program."""
    flight_id: str
    sightings_file: str = ""
    """The flight's sightings, from which the estimate can be computed again."""
    video: str = ""
    link: str = ""
    choice: str = ""
    """How the target was chosen: the operator's box or point, or the rule."""
    noise_preset: str = ""

    def __post_init__(self) -> None:
        """Addresses are kept without their passwords, also those of a log that an older version wrote."""
        for name in ("video", "link"):
            object.__setattr__(self, name, shown_address(getattr(self, name)))


@dataclass(frozen=True, slots=True)
class Geotag:
    """A target's place and motion at one time."""

    id: str
    """Unique among all logs."""
    time_utc: datetime
    """The time at which position and velocity hold; aware, UTC."""
    place: Geodetic
    covariance: tuple[Row6, ...]
    """6 x 6: east, north, up (m), then their rates (m/s)."""
    velocity_enu_m_s: tuple[float, float, float] | None
    method: str
    model: str
    depth_m: float
    """Horizontal distance from the first camera position to the target at the first sighting."""
    sightings: int
    rejected: int
    chi2: float | None
    dof: int | None
    drone: Geodetic | None
    """Where the drone was at that time."""
    provenance: Provenance
    geoid_separation_m: float | None = None
    """Ellipsoid height minus height above mean sea level, where the drone told both."""
    notes: tuple[str, ...] = ()
    picture: bytes = b""
    """The target in the video: JPEG or PNG; empty when there is none."""
    number: int = 0
    """1, 2, ... in the log that holds it; 0 = not logged."""

    @property
    def ce90_m(self) -> float:
        """Radius that holds the truth with probability 0.9."""
        return ce90_m(self.position_covariance[:2, :2])

    @property
    def le90_m(self) -> float:
        """Half the height that holds the truth with probability 0.9."""
        return le90_m(float(self.position_covariance[2, 2]))

    @property
    def ellipse(self) -> ErrorEllipse:
        """The horizontal 95 % ellipse."""
        return error_ellipse(self.position_covariance[:2, :2])

    @property
    def position_covariance(self) -> Matrix:
        """Shape (3, 3), ENU, m2."""
        return np.array(self.covariance, dtype=np.float64)[:3, :3]

    @property
    def speed_m_s(self) -> float | None:
        """Horizontal speed."""
        return None if self.velocity_enu_m_s is None else math.hypot(*self.velocity_enu_m_s[:2])

    @property
    def course_rad(self) -> float | None:
        """Direction of motion, clockwise from true north, 0 to 2 pi; None when nothing moves."""
        if self.velocity_enu_m_s is None or not any(self.velocity_enu_m_s[:2]):
            return None
        return math.atan2(self.velocity_enu_m_s[0], self.velocity_enu_m_s[1]) % (2.0 * math.pi)

    @property
    def ellipsoid_height_m(self) -> float | None:
        """Height above the WGS 84 ellipsoid, where it is known."""
        if self.place.datum == "home" or (self.place.datum == "amsl" and self.geoid_separation_m is None):
            return None
        return altitude_in("ellipsoid", self.place, geoid_separation_m=self.geoid_separation_m)

    @property
    def amsl_m(self) -> float | None:
        """Height above mean sea level, where it is known."""
        if self.place.datum == "home" or (self.place.datum == "ellipsoid" and self.geoid_separation_m is None):
            return None
        return altitude_in("amsl", self.place, geoid_separation_m=self.geoid_separation_m)

    @property
    def picture_type(self) -> str:
        """Media type of the picture, from its first bytes; empty when there is none."""
        if self.picture.startswith(b"\xff\xd8\xff"):
            return "image/jpeg"
        return "image/png" if self.picture.startswith(b"\x89PNG\r\n\x1a\n") else ""


def make_geotag(
    estimate: Estimate,
    origin: GeodeticOrigin,
    *,
    id: str,
    time_utc: datetime,
    provenance: Provenance,
    drone_enu_m: Vector | None = None,
    geoid_separation_m: float | None = None,
    picture: bytes = b"",
) -> Geotag:
    """The geotag of an estimate.

    Args:
        estimate: with a covariance.
        origin: of its local frame; its datum becomes that of every altitude.
        id: unique name of the geotag.
        time_utc: the estimate's `t_s` in UTC; aware, kept to the millisecond.
        provenance: where it comes from.
        drone_enu_m: the drone's position at that time, shape (3,).
        geoid_separation_m: ellipsoid height minus AMSL height, if known.
        picture: of the target, JPEG or PNG.

    Raises:
        AnswerError: the estimate has no covariance, or numbers that cannot be: such an answer is not published.
        ValueError: the time has no time zone, or the picture is neither JPEG nor PNG.
    """
    if time_utc.tzinfo is None:
        raise ValueError("time_utc must have a time zone")
    if estimate.covariance is None:
        raise AnswerError(
            f"The method {estimate.method} gives no covariance, so its answer cannot be a geotag",
            "Estimate with the method batch.",
        )
    numbers = (
        *(estimate.position_enu_m, estimate.covariance, estimate.velocity_enu_m_s),
        *(estimate.depth_m, estimate.chi2, geoid_separation_m, drone_enu_m),
    )
    if not all(np.isfinite(part).all() for part in numbers if part is not None):
        raise AnswerError(
            "The estimate holds numbers that are not finite", "Fly the pattern again; please report this flight."
        )
    variances = np.linalg.eigvalsh(estimate.covariance)
    if variances[0] < -1e-9 * variances[-1] or np.diag(estimate.covariance).min() < 0.0:
        raise AnswerError("The estimate's covariance is impossible", "Fly again; please report this flight.")
    velocity = estimate.velocity_enu_m_s
    geotag = Geotag(
        id=id,
        time_utc=_to_milliseconds(time_utc.astimezone(UTC)),
        place=enu_to_geodetic(estimate.position_enu_m, origin),
        covariance=_rows(estimate.covariance),
        velocity_enu_m_s=None if velocity is None else (float(velocity[0]), float(velocity[1]), float(velocity[2])),
        method=estimate.method,
        model=estimate.model,
        depth_m=float(estimate.depth_m),
        sightings=estimate.sightings,
        rejected=estimate.rejected,
        chi2=estimate.chi2,
        dof=estimate.dof,
        drone=None if drone_enu_m is None else enu_to_geodetic(drone_enu_m, origin),
        provenance=provenance,
        geoid_separation_m=geoid_separation_m,
        notes=estimate.notes,
        picture=picture,
    )
    if picture and not geotag.picture_type:
        raise ValueError("a geotag's picture is JPEG or PNG")
    return geotag


def _rows(covariance: Matrix) -> tuple[Row6, ...]:
    if covariance.shape != (6, 6):
        raise ValueError(f"a covariance is 6 x 6, not {covariance.shape}")
    return tuple((float(a), float(b), float(c), float(d), float(e), float(f)) for a, b, c, d, e, f in covariance)


def _to_milliseconds(time_utc: datetime) -> datetime:
    return time_utc.replace(microsecond=time_utc.microsecond // 1000 * 1000)


@dataclass(frozen=True, slots=True)
class Column:
    """One column of the table that geotags make."""

    name: str
    kind: str
    """GeoPackage type."""
    value: Callable[[Geotag], Cell]


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else math.degrees(angle_rad)


def _time(geotag: Geotag) -> str:
    return geotag.time_utc.strftime("%Y-%m-%dT%H:%M:%S.") + f"{geotag.time_utc.microsecond // 1000:03d}Z"


COLUMNS: tuple[Column, ...] = (
    Column("id", "TEXT NOT NULL UNIQUE", lambda g: g.id),
    Column("time_utc", "DATETIME NOT NULL", _time),
    Column("lat_deg", "DOUBLE NOT NULL", lambda g: g.place.lat_deg),
    Column("lon_deg", "DOUBLE NOT NULL", lambda g: g.place.lon_deg),
    Column("alt_m", "DOUBLE NOT NULL", lambda g: g.place.alt_m),
    Column("alt_datum", "TEXT NOT NULL", lambda g: g.place.datum),
    Column("ellipsoid_height_m", "DOUBLE", lambda g: g.ellipsoid_height_m),
    Column("amsl_m", "DOUBLE", lambda g: g.amsl_m),
    Column("geoid_separation_m", "DOUBLE", lambda g: g.geoid_separation_m),
    Column("ce90_m", "DOUBLE NOT NULL", lambda g: g.ce90_m),
    Column("le90_m", "DOUBLE NOT NULL", lambda g: g.le90_m),
    Column("ellipse95_semi_major_m", "DOUBLE NOT NULL", lambda g: g.ellipse.semi_major_m),
    Column("ellipse95_semi_minor_m", "DOUBLE NOT NULL", lambda g: g.ellipse.semi_minor_m),
    Column("ellipse95_azimuth_deg", "DOUBLE NOT NULL", lambda g: math.degrees(g.ellipse.azimuth_rad)),
    Column("velocity_east_m_s", "DOUBLE", lambda g: g.velocity_enu_m_s and g.velocity_enu_m_s[0]),
    Column("velocity_north_m_s", "DOUBLE", lambda g: g.velocity_enu_m_s and g.velocity_enu_m_s[1]),
    Column("velocity_up_m_s", "DOUBLE", lambda g: g.velocity_enu_m_s and g.velocity_enu_m_s[2]),
    Column("speed_m_s", "DOUBLE", lambda g: g.speed_m_s),
    Column("course_deg", "DOUBLE", lambda g: _degrees(g.course_rad)),
    Column("depth_m", "DOUBLE NOT NULL", lambda g: g.depth_m),
    Column("covariance_enu", "TEXT NOT NULL", lambda g: json.dumps(g.covariance)),
    Column("method", "TEXT NOT NULL", lambda g: g.method),
    Column("model", "TEXT NOT NULL", lambda g: g.model),
    Column("sightings", "INTEGER NOT NULL", lambda g: g.sightings),
    Column("rejected", "INTEGER NOT NULL", lambda g: g.rejected),
    Column("chi2", "DOUBLE", lambda g: g.chi2),
    Column("dof", "INTEGER", lambda g: g.dof),
    Column("drone_lat_deg", "DOUBLE", lambda g: g.drone.lat_deg if g.drone else None),
    Column("drone_lon_deg", "DOUBLE", lambda g: g.drone.lon_deg if g.drone else None),
    Column("drone_alt_m", "DOUBLE", lambda g: g.drone.alt_m if g.drone else None),
    Column("drone_alt_datum", "TEXT", lambda g: g.drone.datum if g.drone else None),
    Column("software", "TEXT NOT NULL", lambda g: g.provenance.software),
    Column("flight_id", "TEXT NOT NULL", lambda g: g.provenance.flight_id),
    Column("sightings_file", "TEXT NOT NULL", lambda g: g.provenance.sightings_file),
    Column("video", "TEXT NOT NULL", lambda g: g.provenance.video),
    Column("link", "TEXT NOT NULL", lambda g: g.provenance.link),
    Column("choice", "TEXT NOT NULL", lambda g: g.provenance.choice),
    Column("noise_preset", "TEXT NOT NULL", lambda g: g.provenance.noise_preset),
    Column("notes", "TEXT NOT NULL", lambda g: json.dumps(g.notes, ensure_ascii=False)),
    Column("picture_type", "TEXT NOT NULL", lambda g: g.picture_type),
    Column("picture", "BLOB", lambda g: g.picture or None),
)
"""A geotag as one flat row: the columns of the log and of a CSV file, and the properties of a GeoJSON feature."""


def row(geotag: Geotag) -> dict[str, Cell]:
    """The columns by name. A file name that is no UTF-8 is spelled out, so that every format can hold it."""
    cells = ((column.name, column.value(geotag)) for column in COLUMNS)
    return {name: _storable(cell) if isinstance(cell, str) else cell for name, cell in cells}


def as_json(geotag: Geotag) -> dict[str, object]:
    """The row as JSON values: number and columns but for the picture, covariance and notes nested."""
    columns: dict[str, object] = {name: cell for name, cell in row(geotag).items() if name != "picture"}
    notes = [_storable(note) for note in geotag.notes]
    return {"number": geotag.number, **columns, "covariance_enu": geotag.covariance, "notes": notes}


def _storable(text: str) -> str:
    return text.encode("utf-8", "backslashreplace").decode("utf-8")
