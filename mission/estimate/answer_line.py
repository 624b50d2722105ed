"""The answer to one flight as a line of JSON (the output half of the sightings format)."""

from __future__ import annotations

import json
import math

from mission.geodesy import ce90_m, enu_to_geodetic, le90_m
from mission.records import Estimate, GeodeticOrigin, Matrix, Vector


def estimate_line(estimate: Estimate, origin: GeodeticOrigin) -> str:
    """The estimate as the format's output line, without a line end; what a method cannot give is null.

    Args:
        estimate: in the local ENU frame.
        origin: of that frame.

    Raises:
        AnswerError: the position has no place on the earth.
        ValueError: a number is not finite.
    """
    place = enu_to_geodetic(estimate.position_enu_m, origin)
    covariance, first = estimate.covariance, estimate.first
    return json.dumps(
        {
            "id": estimate.id,
            "method": estimate.method,
            "model": estimate.model,
            "t_s": estimate.t_s,
            "position_enu_m": _vector(estimate.position_enu_m),
            "velocity_enu_m_s": None if estimate.velocity_enu_m_s is None else _vector(estimate.velocity_enu_m_s),
            "covariance": None if covariance is None else _matrix(covariance),
            "lat_deg": place.lat_deg,
            "lon_deg": place.lon_deg,
            "alt_m": place.alt_m,
            "datum": place.datum,
            "first": None
            if first is None
            else {
                "t_s": first.t_s,
                "position_enu_m": _vector(first.position_enu_m),
                "covariance": _matrix(first.covariance) if _known(first.covariance) else None,
            },
            "depth_m": estimate.depth_m,
            "ce90_m": None if covariance is None else ce90_m(covariance[:2, :2]),
            "le90_m": None if covariance is None else le90_m(float(covariance[2, 2])),
            "sightings": estimate.sightings,
            "rejected": estimate.rejected,
            "chi2": estimate.chi2,
            "dof": estimate.dof,
            "notes": list(estimate.notes),
        },
        allow_nan=False,
    )


def error_line(flight_id: str | None, why: str) -> str:
    """The line of a flight without an answer."""
    return json.dumps({"id": flight_id, "error": why})


def _vector(values: Vector) -> list[float]:
    return [float(value) for value in values]


def _matrix(values: Matrix) -> list[list[float]]:
    return [_vector(row) for row in values]


def _known(covariance: Matrix) -> bool:
    """Closed forms have no covariance: theirs is NaN."""
    return math.isfinite(float(covariance.sum()))
