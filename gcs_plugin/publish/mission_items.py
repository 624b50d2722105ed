"""A waypoint at a stand-off from the target, appended to the plan that is on the vehicle. The operator's items stay."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from gcs_plugin.publish.mission_protocol import MissionItem, MissionProtocol
from mission.errors import AnswerError
from mission.geodesy import Geodetic, altitude_in, enu_to_geodetic, geodetic_to_enu
from mission.records import GeodeticOrigin

HEIGHT_TOLERANCE_M: Final = 0.02
"""ArduPilot keeps heights in centimetres, and cuts off what is less."""
PARAM_TOLERANCE: Final = 1e-5
"""Relative, or absolute below 1: PX4 keeps headings in radians."""
PATIENCE_S: Final = 60.0
"""All four transfers of the plan together take no longer: meanwhile no station can read or write it."""
_TRANSFERS: Final = 4
_HIGHEST_M: Final = 1e5
"""No height; above it single precision has no centimetres."""
# The "_INT" twins of the frames mean the same in MISSION_ITEM_INT; PX4 answers with them.
_PLAIN_FRAME: Final = {
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
}

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Appended:
    """A waypoint that is in the plan on the vehicle."""

    number: int
    """In the plan, from 0."""
    warning: str = ""
    """Why it will not be flown to by itself; empty, or a clause to go on with."""


def standoff_waypoint(
    target: Geodetic, drone: Geodetic, *, distance_m: float, geoid_separation_m: float | None = None
) -> MissionItem:
    """A waypoint between drone and target, facing the target, as high above the sea as the drone was.

    Not above home: a station may move home in flight, and the take-off point is another place again. A drone that is
    nearer than the stand-off already stays where it is.

    Args:
        target: where the target is; its altitude does not matter.
        drone: where the drone was.
        distance_m: horizontal distance to keep from the target, more than 0.
        geoid_separation_m: ellipsoid height minus AMSL height, if known; for a drone above the ellipsoid.

    Raises:
        AnswerError: the height above the sea is not known, or the distance is not positive.
    """
    if not (math.isfinite(drone.alt_m) and math.isfinite(distance_m) and distance_m > 0.0):
        raise AnswerError(
            f"No waypoint {distance_m} m from the target at {drone.alt_m} m",
            "Set a stand-off above 0 m, and wait until the autopilot reports its height.",
        )
    height_amsl_m = altitude_in("amsl", drone, geoid_separation_m=geoid_separation_m)
    centre = GeodeticOrigin(target.lat_deg, target.lon_deg, 0.0)
    east, north, _ = geodetic_to_enu(drone.lat_deg, drone.lon_deg, 0.0, centre)
    away = math.hypot(east, north)
    share = min(1.0, distance_m / away) if away > 0.0 else 0.0
    place = enu_to_geodetic(np.array([share * east, share * north, 0.0]), centre)
    heading_deg = math.degrees(math.atan2(-east, -north)) % 360.0 if away > 0.0 else math.nan
    return MissionItem(
        frame=mavlink.MAV_FRAME_GLOBAL,
        command=mavlink.MAV_CMD_NAV_WAYPOINT,
        params=(0.0, 0.0, 0.0, heading_deg),
        x=round(place.lat_deg * 1e7),
        y=round(place.lon_deg * 1e7),
        z=height_amsl_m,
    )


def append_item(protocol: MissionProtocol, item: MissionItem) -> Appended:
    """Append an item to the plan on the vehicle: download, look again, upload, read back, compare.

    When something fails on the way, what is on the vehicle is read and, where it is not the operator's plan, that plan
    is written back. The protocol has no lock: between the second look and the first item written, a round trip long, a
    plan that a station writes at the same time is still lost.

    Returns:
        Its number, and a warning where the plan ends or turns back before it.

    Raises:
        AnswerError: it could not be appended; the message says what became of the operator's plan.
    """
    try:
        plan = _Plans(protocol.autopilot() == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
        before = protocol.download(within_s=PATIENCE_S / _TRANSFERS)
        if not plan.same(protocol.download(), before):
            raise AnswerError(
                "Another station writes the plan on the vehicle",
                "Wait until it is done and ask for the waypoint again.",
            )
    except AnswerError as error:
        raise AnswerError(f"{error.cause}; the plan on the vehicle was not touched", error.remedy) from error
    # ArduPilot puts its home into item 0 whatever is sent; in an empty plan that place must be filled.
    wanted = (*before, *((item,) if len(before) < plan.home else ()), item)
    problem: AnswerError | None = None
    try:
        protocol.upload(plan.to_send(wanted))
    except AnswerError as error:
        problem = error
    try:
        after = protocol.download()
    except AnswerError as error:
        raise _unknown(problem or error) from error
    if len(after) == len(wanted) and plan.same(after[:-1], wanted[:-1]) and _arrived(after[-1], item):
        if problem is not None:
            _log.info("the vehicle has the new plan in spite of: %s", problem)
        return Appended(len(wanted) - 1, _ends_before(before))
    if problem is None:
        problem = AnswerError("The vehicle accepted the waypoint but does not read it back", "Add it by hand.")
    if not plan.same(after, before):
        _restore(protocol, before, plan, problem)
    raise AnswerError(f"{problem.cause}; the operator's plan is on the vehicle as it was", problem.remedy) from problem


def _restore(protocol: MissionProtocol, before: Sequence[MissionItem], plan: _Plans, problem: AnswerError) -> None:
    """Write the operator's plan back and see that it is there."""
    try:
        try:
            protocol.upload(plan.to_send(before))
        except AnswerError as error:  # what counts is what can be read back
            _log.warning("while writing the operator's plan back: %s", error)
        restored = plan.same(protocol.download(), before)
    except AnswerError as error:
        raise _unknown(problem) from error
    if not restored:
        raise _unknown(problem)


def _unknown(problem: AnswerError) -> AnswerError:
    return AnswerError(
        f"{problem.cause}; the plan on the vehicle may be incomplete",
        "Upload your plan again from the ground station before flying it.",
    )


class _Plans:
    """How one kind of autopilot keeps plans."""

    def __init__(self, ardupilot: bool) -> None:
        self._ardupilot = ardupilot
        self.home = 1 if ardupilot else 0
        """Items before the operator's first."""

    def same(self, one: Sequence[MissionItem], other: Sequence[MissionItem]) -> bool:
        """Whether two plans are the same, home apart and as far as autopilots keep what they are given."""
        home = self.home
        if max(len(one), home) != max(len(other), home):  # a plan of only home, and none, are the same
            return False
        return all(_kept(a, b) for a, b in zip(one[home:], other[home:], strict=True))

    def to_send(self, items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
        """Items as they must be sent to be kept as they were read.

        ArduPilot reports a height of 159 cm as 1.5899999 m and cuts the centimetres off what it is sent: 158 of them.
        Sent the next larger number in single precision, it keeps 159.
        """
        if not self._ardupilot:
            return tuple(items)
        return tuple(replace(each, z=_uncut(each.z)) if _is_place(each) else each for each in items)


def _uncut(height_m: float) -> float:
    """The height itself or, where its centimetres would be cut to one less, the next number of which they are not."""
    if not math.isfinite(height_m) or abs(height_m) > _HIGHEST_M:
        return height_m
    centimetres = round(height_m * 100.0)
    if abs(height_m * 100.0 - centimetres) > 0.01:  # not kept in centimetres
        return height_m
    sent = np.float32(height_m)
    away = np.float32(math.copysign(math.inf, centimetres))
    while abs(int(sent * np.float32(100.0))) < abs(centimetres):  # AP_Mission.cpp, in single precision
        sent = np.nextafter(sent, away)
    return float(sent)


def _is_place(item: MissionItem) -> bool:
    """Whether z is a height."""
    return item.command < mavlink.MAV_CMD_NAV_LAST or item.command in _PLACES


def _kept(one: MissionItem, other: MissionItem) -> bool:
    """Whether two items are the same, as far as autopilots keep what they are given."""
    return (
        one.command == other.command
        and _PLAIN_FRAME.get(one.frame, one.frame) == _PLAIN_FRAME.get(other.frame, other.frame)
        and one.autocontinue == other.autocontinue
        and abs(one.x - other.x) <= 1
        and abs(one.y - other.y) <= 1
        and _close(one.z, other.z, HEIGHT_TOLERANCE_M if _is_place(one) else PARAM_TOLERANCE * max(1.0, abs(one.z)))
        and all(_close(a, b, PARAM_TOLERANCE * max(1.0, abs(a))) for a, b in zip(one.params, other.params, strict=True))
    )


def _close(one: float, other: float, tolerance: float) -> bool:
    return (math.isnan(one) and math.isnan(other)) or one == other or abs(one - other) <= tolerance


def _arrived(read: MissionItem, sent: MissionItem) -> bool:
    """Whether the new waypoint was read back as sent; ArduPilot keeps no heading in it."""
    return math.isfinite(read.z) and _kept(replace(read, params=sent.params, autocontinue=sent.autocontinue), sent)


_PLACES: Final = (
    mavlink.MAV_CMD_DO_SET_HOME,
    mavlink.MAV_CMD_DO_LAND_START,
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
    mavlink.MAV_CMD_DO_SET_ROI,
)
"""Commands with a place beside those that navigate, which have the numbers below `MAV_CMD_NAV_LAST`."""
_ENDS: Final = {
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: "returns home",
    mavlink.MAV_CMD_NAV_LAND: "lands",
    mavlink.MAV_CMD_NAV_VTOL_LAND: "lands",
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: "waits for ever",
}


def _ends_before(plan: Sequence[MissionItem]) -> str:
    """Why a waypoint behind this plan is not flown to by itself; empty when it is."""
    for number, item in enumerate(plan):
        what = _ENDS.get(item.command, "")
        if item.command == mavlink.MAV_CMD_DO_JUMP and item.params[1] < 0.0 and item.params[0] <= number:
            what = f"jumps back to item {item.params[0]:.0f} for ever"
        if what:
            return (
                f", which the plan does not reach by itself: it {what} at item {number}. "
                "Order the vehicle to the new item by hand, or move it before that one"
            )
    return ""
