"""One answer, for tests: a target that walks east, 9 m north of the drone."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import cv2
import numpy as np

from gcs_plugin.geotags.log import Geotag, Provenance, make_geotag
from mission.records import Datum, Estimate, FirstPosition, GeodeticOrigin

ORIGIN = GeodeticOrigin(37.2276, 126.8405, 30.0, "ellipsoid")
NOON = datetime(2026, 11, 22, 12, 0, 6, 250_000, UTC)


def origin(datum: Datum) -> GeodeticOrigin:
    return replace(ORIGIN, datum=datum)


def estimate(
    position: tuple[float, float, float] = (0.1, 9.0, 0.9),
    velocity: tuple[float, float, float] | None = (0.6, 0.0, 0.0),
) -> Estimate:
    covariance = np.diag([0.04, 0.16, 0.01, 0.0025, 0.0049, 0.0001])
    covariance[0, 1] = covariance[1, 0] = 0.03
    return Estimate(
        id="flight-1",
        method="batch",
        model="constant-velocity",
        t_s=106.25,
        position_enu_m=np.array(position),
        velocity_enu_m_s=None if velocity is None else np.array(velocity),
        covariance=covariance,
        first=FirstPosition(100.25, np.array([-3.5, 9.0, 0.9]), np.diag([0.05, 0.2, 0.01])),
        depth_m=9.0,
        sightings=121,
        rejected=2,
        chi2=250.1,
        dof=357,
        notes=("camera not calibrated: <wide> & unsure",),
    )


def jpeg(size: int = 32) -> bytes:
    image = np.random.default_rng(1).integers(0, 255, (size, size, 3), dtype=np.uint8)
    return cv2.imencode(".jpg", image)[1].tobytes()


def geotag(
    name: str = "tag-1",
    *,
    where: Estimate | None = None,
    at: GeodeticOrigin = ORIGIN,
    geoid_separation_m: float | None = 23.5,
    picture: bytes = b"",
) -> Geotag:
    return make_geotag(
        estimate() if where is None else where,
        at,
        id=name,
        time_utc=NOON,
        provenance=Provenance(
            "sidestep 0.1.0", "flight-1", "sightings.jsonl", "udp://:5600", "udpin://:14540", "nearest", "good"
        ),
        drone_enu_m=np.array([0.0, 0.0, 3.0]),
        geoid_separation_m=geoid_separation_m,
        picture=picture,
    )
