"""Cursor on Target events (MITRE's schema, version 2.0): the target, its error ellipse, the drone.

Heights are above the WGS 84 ellipsoid. What a point's `ce` means is not agreed on: MISB ST 0805, which says how KLV
becomes CoT, makes it one standard deviation (CE90 / 2.146), others write a 90 % radius; the setting `tak.ce` chooses,
and the remarks always say CE90 in words.
"""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Final

from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.outline import ellipse_rings
from gcs_plugin.geotags.words import description, moves
from gcs_plugin.xml_text import element, xml_text, zulu
from mission.geodesy import Geodetic
from mission.settings import CircularError, TakSettings

UNKNOWN: Final = "9999999.0"
"""The schema's "not known" of hae, ce and le."""
CE90_SIGMAS: Final = 2.146
LE90_SIGMAS: Final = 1.645
DRONE_TYPE: Final = "a-n-A-M-H-Q"
"""A neutral unmanned aircraft with rotors."""
_FUSED: Final = "m-f"
_RED, _AMBER = "-65536", "-23296"
_OUTLINE_POINTS: Final = 36
DRONE_STALE_S: Final = 15.0


@dataclass(frozen=True, slots=True)
class DroneState:
    """The drone as others see it."""

    uid: str
    callsign: str
    place: Geodetic
    ellipsoid_height_m: float | None
    course_rad: float | None = None
    speed_m_s: float | None = None
    heading_rad: float | None = None
    """Where its camera looks, clockwise from true north."""
    hfov_rad: float | None = None
    tilt_down_rad: float = 0.0
    range_m: float = 50.0
    """How long the field of view is drawn."""


def target_event(geotag: Geotag, settings: TakSettings, now: datetime, drone_uid: str = "") -> bytes:
    """The target: a marker with course and speed, its accuracy, and all that is known in `<sidestep>`.

    The marker of a target that moves is soon stale; that of a still one stays.

    Args:
        geotag: the answer.
        settings: type, stale times, and what `ce` means.
        now: when the event is sent.
        drone_uid: who saw it.
    """
    moving = moves(geotag)
    stale_s = settings.stale_moving_s if moving else settings.stale_s
    root = _event(target_uid(geotag), settings.type, now, geotag.time_utc, stale_s)
    _point(root, geotag.place, geotag.ellipsoid_height_m, *_errors(geotag, settings.ce))
    detail = ET.SubElement(root, "detail")
    element(detail, "contact", callsign=callsign(geotag))
    element(detail, "precisionlocation", geopointsrc="CALC", altsrc="CALC")
    if moving and geotag.course_rad is not None and geotag.speed_m_s is not None:
        course_deg = f"{math.degrees(geotag.course_rad):.1f}"
        element(detail, "track", course=course_deg, speed=f"{geotag.speed_m_s:.2f}")
    remark = f"{description(geotag)} The point's ce is {'one sigma' if settings.ce == 'one-sigma' else 'CE90'}."
    element(detail, "remarks", remark, source="sidestep", time=zulu(now))
    if drone_uid:
        element(detail, "link", uid=drone_uid, type=DRONE_TYPE, relation="p-p")
    if not moving:
        element(detail, "archive")
    element(detail, "color", argb=_RED)
    element(
        detail,
        "sidestep",
        flight=geotag.provenance.flight_id,
        id=geotag.id,
        method=geotag.method,
        model=geotag.model,
        ce90=f"{geotag.ce90_m:.3f}",
        le90=f"{geotag.le90_m:.3f}",
        covariance_enu=json.dumps(geotag.covariance),
    )
    return _written(root)


def ellipse_event(geotag: Geotag, settings: TakSettings, now: datetime) -> bytes:
    """The 95 % ellipse as a closed polygon: every client draws one, and not every one an ellipse."""
    stale_s = settings.stale_moving_s if moves(geotag) else settings.stale_s
    root = _event(f"{target_uid(geotag)}.ellipse", "u-d-f", now, geotag.time_utc, stale_s)
    _point(root, geotag.place, geotag.ellipsoid_height_m, UNKNOWN, UNKNOWN)
    detail = ET.SubElement(root, "detail")
    for ring in ellipse_rings(geotag):
        step = max(1, (len(ring) - 1) // _OUTLINE_POINTS)
        for lon, lat, *_ in [*ring[:-1:step], ring[0]]:
            element(detail, "link", point=f"{lat:.8f},{lon:.8f}")
    element(detail, "contact", callsign=f"{callsign(geotag)} 95 %")
    element(detail, "strokeColor", value=_AMBER)
    element(detail, "strokeWeight", value="2.0")
    element(detail, "fillColor", value=str((0x30FFA500 ^ 0x80000000) - 0x80000000))
    element(detail, "labels_on", value="false")
    element(detail, "remarks", "95 % of such ellipses hold the target at the event's start time.", source="sidestep")
    if not moves(geotag):
        element(detail, "archive")
    return _written(root)


def drone_event(drone: DroneState, now: datetime, video_url: str = "") -> bytes:
    """The drone, where it looks, and where its video is."""
    root = _event(drone.uid, DRONE_TYPE, now, now, DRONE_STALE_S, how="m-g")
    _point(root, drone.place, drone.ellipsoid_height_m, UNKNOWN, UNKNOWN)
    detail = ET.SubElement(root, "detail")
    element(detail, "contact", callsign=drone.callsign)
    if drone.course_rad is not None and drone.speed_m_s is not None:
        element(detail, "track", course=f"{math.degrees(drone.course_rad) % 360.0:.1f}", speed=f"{drone.speed_m_s:.2f}")
    if drone.heading_rad is not None and drone.hfov_rad is not None:
        azimuth_deg = math.degrees(drone.heading_rad) % 360.0
        element(
            detail,
            "sensor",
            azimuth=f"{azimuth_deg:.1f}",
            elevation=f"{-math.degrees(drone.tilt_down_rad):.1f}",
            roll="0",
            fov=f"{math.degrees(drone.hfov_rad):.1f}",
            vfov="0",
            range=f"{drone.range_m:.0f}",
            north="0",
            type="r-e",
            model="Sidestep",
        )
    if video_url:
        element(detail, "__video", url=video_url)
    return _written(root)


def target_uid(geotag: Geotag) -> str:
    """The same for the same target, so that its marker moves instead of being doubled."""
    return f"sidestep.{geotag.id}"


def callsign(geotag: Geotag) -> str:
    """The marker's label."""
    return f"TGT {geotag.number}" if geotag.number else "TGT"


def _errors(geotag: Geotag, meaning: CircularError) -> tuple[str, str]:
    one_sigma = meaning == "one-sigma"
    ce_m = geotag.ce90_m / (CE90_SIGMAS if one_sigma else 1.0)
    le_m = geotag.le90_m / (LE90_SIGMAS if one_sigma else 1.0)
    return f"{ce_m:.2f}", f"{le_m:.2f}"


def _event(uid: str, kind: str, now: datetime, start: datetime, stale_s: float, how: str = _FUSED) -> ET.Element:
    return ET.Element(
        "event",
        {
            "version": "2.0",
            "uid": xml_text(uid),
            "type": kind,
            "how": how,
            "time": zulu(now),
            "start": zulu(start),
            "stale": zulu(start + timedelta(seconds=stale_s)),
        },
    )


def _point(root: ET.Element, place: Geodetic, height_m: float | None, ce: str, le: str) -> None:
    hae = UNKNOWN if height_m is None else f"{height_m:.2f}"
    element(root, "point", lat=f"{place.lat_deg:.8f}", lon=f"{place.lon_deg:.8f}", hae=hae, ce=ce, le=le)


def _written(root: ET.Element) -> bytes:
    return f'<?xml version="1.0" encoding="UTF-8"?>{ET.tostring(root, encoding="unicode")}'.encode()
