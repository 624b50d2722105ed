"""Geodetic <-> local ENU on WGS 84, altitudes in another datum, and what a covariance means on the ground.

The transform between latitude, longitude, height and earth-centred coordinates is PROJ's (EPSG:4979 <-> EPSG:4978);
the rotation into the local frame is exact, so a point keeps its distance from the origin to the micrometre. Only the
origin's altitude is not always an ellipsoid height: where it is above mean sea level or above home, it is used as if it
were one, which scales horizontal distances by height difference / earth radius (50 m of geoid: 8e-6, 0.1 mm in 10 m)
and leaves the result in the origin's datum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from pyproj import Transformer
from scipy.optimize import brentq

from mission.errors import AnswerError
from mission.records import Datum, GeodeticOrigin, Matrix, Vector

NORMAL_90: Final = 1.6448536269514722
"""Half width of the central 90 % of a normal distribution, in sigmas."""
RAYLEIGH_90: Final = math.sqrt(-2.0 * math.log(0.1))
"""Radius of 90 % of a circular normal distribution, in sigmas (2.1460)."""

# PROJ's objects belong to one thread; pyproj >= 3.1 keeps one per thread behind each Transformer made from a CRS.
_TO_ECEF = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
_TO_GEODETIC = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)

# Midpoints of equal steps over a quarter turn: CE90's integrand is periodic, so this rule converges exponentially.
_QUARTER_TURN = (np.arange(256) + 0.5) * (math.pi / 512.0)


@dataclass(frozen=True, slots=True)
class Geodetic:
    """A place on WGS 84; `datum` says what `alt_m` is measured from."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    datum: Datum


@dataclass(frozen=True, slots=True)
class ErrorEllipse:
    """Half axes, and the azimuth of the major one, clockwise from north, 0 <= azimuth < pi."""

    semi_major_m: float
    semi_minor_m: float
    azimuth_rad: float

    def outline(self, points: int = 72) -> Matrix:
        """The outline as (east, north) from the centre, counter-clockwise, not closed; shape (points, 2), metres."""
        turn = 2.0 * np.pi * np.arange(points) / points
        along, across = self.semi_major_m * np.cos(turn), self.semi_minor_m * np.sin(turn)
        sine, cosine = math.sin(self.azimuth_rad), math.cos(self.azimuth_rad)
        # The minor axis is the major one turned counter-clockwise by a quarter: (sin, cos) -> (-cos, sin).
        return np.column_stack((along * sine - across * cosine, along * cosine + across * sine))


def enu_to_geodetic(position_enu_m: Vector, origin: GeodeticOrigin) -> Geodetic:
    """Latitude, longitude and altitude of a point of the local frame.

    Args:
        position_enu_m: shape (3,), relative to `origin`.
        origin: where east = north = up = 0.

    Returns:
        The place; its altitude has the origin's datum, longitude in [-180, 180].

    Raises:
        ValueError: a coordinate is not finite, or the origin's latitude is beyond a pole.
    """
    offset = np.asarray(position_enu_m, dtype=np.float64)
    if offset.shape != (3,) or not np.isfinite(offset).all():
        raise ValueError(f"position_enu_m must be three finite numbers, not {position_enu_m!r}")
    centre, ecef_from_enu = _frame(origin.lat_deg, origin.lon_deg, origin.alt_m)
    x, y, z = centre + ecef_from_enu @ offset
    lon_deg, lat_deg, alt_m = _TO_GEODETIC.transform(x, y, z)
    return Geodetic(float(lat_deg), float(lon_deg), float(alt_m), origin.datum)


def geodetic_to_enu(lat_deg: float, lon_deg: float, alt_m: float, origin: GeodeticOrigin) -> Vector:
    """The point of the local frame at a latitude, longitude and altitude.

    Args:
        lat_deg: latitude, -90 to 90.
        lon_deg: longitude, any turn.
        alt_m: altitude in the origin's datum.
        origin: where east = north = up = 0.

    Returns:
        east, north, up, metres, shape (3,).

    Raises:
        ValueError: a coordinate is not finite, or a latitude is beyond a pole.
    """
    centre, ecef_from_enu = _frame(origin.lat_deg, origin.lon_deg, origin.alt_m)
    point: Vector = ecef_from_enu.T @ (_ecef(lat_deg, lon_deg, alt_m) - centre)
    return point


def altitude_in(
    datum: Datum, place: Geodetic, *, geoid_separation_m: float | None = None, home_amsl_m: float | None = None
) -> float:
    """A place's altitude in another datum. Nothing is guessed: what the conversion needs must be given.

    Args:
        datum: the wanted datum.
        place: whose altitude.
        geoid_separation_m: ellipsoid height minus height above mean sea level, here.
        home_amsl_m: the home position's height above mean sea level.

    Raises:
        AnswerError: the conversion needs a height that was not given.
    """
    if datum == place.datum:
        return place.alt_m
    separation = home = 0.0
    unknown = f"An altitude above the {_SAID[place.datum]} cannot be given above the {_SAID[datum]}"
    if "ellipsoid" in (datum, place.datum):
        if geoid_separation_m is None or not math.isfinite(geoid_separation_m):
            raise AnswerError(
                f"{unknown}: the geoid separation is unknown",
                "Wait until the autopilot sends GPS_RAW_INT with alt_ellipsoid, or set the geoid separation.",
            )
        separation = geoid_separation_m
    if "home" in (datum, place.datum):
        if home_amsl_m is None or not math.isfinite(home_amsl_m):
            raise AnswerError(
                f"{unknown}: the home altitude is unknown", "Wait until the autopilot sends HOME_POSITION."
            )
        home = home_amsl_m
    above_sea_m = place.alt_m + {"ellipsoid": -separation, "amsl": 0.0, "home": home}[place.datum]
    return above_sea_m + {"ellipsoid": separation, "amsl": 0.0, "home": -home}[datum]


_SAID: Final[dict[Datum, str]] = {"ellipsoid": "ellipsoid", "amsl": "mean sea level", "home": "home position"}


def error_ellipse(covariance_2x2: Matrix, probability: float = 0.95) -> ErrorEllipse:
    """The ellipse that holds a bivariate normal error with the given probability.

    Args:
        covariance_2x2: east, north, m2, shape (2, 2).
        probability: 0 < probability < 1.

    Raises:
        ValueError: the covariance is not finite or not positive semi-definite, or the probability is out of range.
    """
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability must lie between 0 and 1, not {probability}")
    variances, axes = _principal(covariance_2x2)
    scale = math.sqrt(-2.0 * math.log1p(-probability))  # chi-square with two degrees of freedom is exponential
    east, north = axes[:, 1]
    azimuth = math.atan2(east, north) % math.pi
    return ErrorEllipse(scale * math.sqrt(variances[1]), scale * math.sqrt(variances[0]), azimuth % math.pi)


def ce90_m(covariance_2x2: Matrix) -> float:
    """Circular error 90 %: the radius around the estimate that holds the truth with probability 0.9, exactly.

    With the error written as (s1 r cos u, s2 r sin u), r Rayleigh and u uniform, the probability of lying outside of
    radius R is the mean over u of exp(-R^2 / (2 (s1^2 cos^2 u + s2^2 sin^2 u))); CE90 is the R at which it is 0.1.
    Unlike the integral over x and y, this one stays smooth when the ellipse degenerates into a line.

    Args:
        covariance_2x2: of two horizontal axes, m2, shape (2, 2).

    Raises:
        ValueError: the covariance is not finite or not positive semi-definite.
    """
    variances, _ = _principal(covariance_2x2)
    major = math.sqrt(variances[1])
    if major == 0.0:
        return 0.0
    aspect = variances[0] / variances[1]
    spread = 2.0 * (np.cos(_QUARTER_TURN) ** 2 + aspect * np.sin(_QUARTER_TURN) ** 2)

    def outside(radius: float) -> float:
        return float(np.mean(np.exp(-(radius**2) / spread))) - 0.1

    # Between a line (one dimension) and a circle, widened by rounding.
    return major * float(brentq(outside, NORMAL_90 - 1e-6, RAYLEIGH_90 + 1e-6, xtol=1e-12))


def le90_m(variance_m2: float) -> float:
    """Linear error 90 %: half the height of the interval around the estimate that holds the truth with probability 0.9.

    Raises:
        ValueError: the variance is negative or not finite.
    """
    if not (math.isfinite(variance_m2) and variance_m2 >= 0.0):
        raise ValueError(f"a variance is finite and not negative, not {variance_m2}")
    return NORMAL_90 * math.sqrt(variance_m2)


@lru_cache(maxsize=64)
def _frame(lat_deg: float, lon_deg: float, alt_m: float) -> tuple[Vector, Matrix]:
    """The origin in earth-centred coordinates, and `ecef_from_enu` (columns east, north, up)."""
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    centre = _ecef(lat_deg, lon_deg, alt_m)
    east = (-math.sin(lon), math.cos(lon), 0.0)
    north = (-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat))
    up = (math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat))
    axes = np.column_stack((east, north, up))
    centre.flags.writeable = axes.flags.writeable = False  # shared through the cache
    return centre, axes


def _ecef(lat_deg: float, lon_deg: float, alt_m: float) -> Vector:
    if not (math.isfinite(lat_deg) and math.isfinite(lon_deg) and math.isfinite(alt_m) and abs(lat_deg) <= 90.0):
        raise ValueError(f"not a place on earth: latitude {lat_deg}, longitude {lon_deg}, altitude {alt_m}")
    return np.array(_TO_ECEF.transform(math.remainder(lon_deg, 360.0), lat_deg, alt_m), dtype=np.float64)


def _principal(covariance_2x2: Matrix) -> tuple[Vector, Matrix]:
    """Variances along the principal axes, ascending and not negative, and the axes as columns."""
    covariance = np.asarray(covariance_2x2, dtype=np.float64)
    if covariance.shape != (2, 2) or not np.isfinite(covariance).all():
        raise ValueError("a horizontal covariance is 2 x 2 and finite")
    variances, axes = np.linalg.eigh((covariance + covariance.T) / 2.0)
    if variances[0] < -1e-9 * max(abs(variances[1]), abs(variances[0])):
        raise ValueError("a covariance is positive semi-definite")
    return np.maximum(variances, 0.0), axes
