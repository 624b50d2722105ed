"""A waypoint at a stand-off from the target, appended to the plan that is on the vehicle. The operator's items stay."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from gcs_plugin.mission_protocol import MissionItem, MissionProtocol
from mission.errors import AnswerError
from mission.geodesy import Geodetic, enu_to_geodetic, geodetic_to_enu
from mission.records import GeodeticOrigin

HEIGHT_TOLERANCE_M: Final = 0.02
"""ArduPilot keeps heights in centimetres."""
# The "_INT" twins of the frames mean the same in MISSION_ITEM_INT; PX4 answers with them.
_PLAIN_FRAME: Final = {
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
}

_log = logging.getLogger(__name__)


def standoff_waypoint(
    target: Geodetic, drone: Geodetic, *, distance_m: float, height_above_home_m: float
) -> MissionItem:
    """A waypoint between drone and target, facing the target, at the drone's height above home.

    A drone that is nearer than the stand-off already stays where it is.

    Args:
        target: where the target is; its altitude does not matter.
        drone: where the drone is; likewise.
        distance_m: horizontal distance to keep from the target, more than 0.
        height_above_home_m: the drone's height, as the autopilot reports it above home.

    Raises:
        AnswerError: the height is not known, or the distance is not positive.
    """
    if not (math.isfinite(height_above_home_m) and math.isfinite(distance_m) and distance_m > 0.0):
        raise AnswerError(
            f"No waypoint {distance_m} m from the target at {height_above_home_m} m above home",
            "Set a stand-off above 0 m, and wait until the autopilot reports its height.",
        )
    centre = GeodeticOrigin(target.lat_deg, target.lon_deg, 0.0)
    east, north, _ = geodetic_to_enu(drone.lat_deg, drone.lon_deg, 0.0, centre)
    away = math.hypot(east, north)
    share = min(1.0, distance_m / away) if away > 0.0 else 0.0
    place = enu_to_geodetic(np.array([share * east, share * north, 0.0]), centre)
    heading_deg = math.degrees(math.atan2(-east, -north)) % 360.0 if away > 0.0 else math.nan
    return MissionItem(
        frame=mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        command=mavlink.MAV_CMD_NAV_WAYPOINT,
        params=(0.0, 0.0, 0.0, heading_deg),
        x=round(place.lat_deg * 1e7),
        y=round(place.lon_deg * 1e7),
        z=height_above_home_m,
    )


def append_item(protocol: MissionProtocol, item: MissionItem) -> int:
    """Append an item to the plan on the vehicle: download, upload, read back, compare.

    When something fails on the way, what is on the vehicle is read and, where it is not the operator's plan, that plan
    is written back.

    Returns:
        The item's number in the plan, from 0.

    Raises:
        AnswerError: it could not be appended; the message says what became of the operator's plan.
    """
    try:
        home = 1 if protocol.autopilot() == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA else 0
        before = protocol.download()
    except AnswerError as error:
        raise AnswerError(f"{error.cause}; the plan on the vehicle was not touched", error.remedy) from error
    # ArduPilot puts its home into item 0 whatever is sent; in an empty plan that place must be filled.
    wanted = (*before, *((item,) if len(before) < home else ()), item)
    problem: AnswerError | None = None
    try:
        protocol.upload(wanted)
    except AnswerError as error:
        problem = error
    try:
        after = protocol.download()
    except AnswerError as error:
        raise _unknown(problem or error) from error
    if len(after) == len(wanted) and _same(after[:-1], wanted[:-1], home) and _arrived(after[-1], item):
        if problem is not None:
            _log.info("the vehicle has the new plan in spite of: %s", problem)
        return len(wanted) - 1
    if problem is None:
        problem = AnswerError("The vehicle accepted the waypoint but does not read it back", "Add it by hand.")
    if not _same(after, before, home):
        _restore(protocol, before, home, problem)
    raise AnswerError(f"{problem.cause}; the operator's plan is on the vehicle as it was", problem.remedy) from problem


def _restore(protocol: MissionProtocol, before: Sequence[MissionItem], home: int, problem: AnswerError) -> None:
    """Write the operator's plan back and see that it is there."""
    try:
        try:
            protocol.upload(before)
        except AnswerError as error:  # what counts is what can be read back
            _log.warning("while writing the operator's plan back: %s", error)
        restored = _same(protocol.download(), before, home)
    except AnswerError as error:
        raise _unknown(problem) from error
    if not restored:
        raise _unknown(problem)


def _unknown(problem: AnswerError) -> AnswerError:
    return AnswerError(
        f"{problem.cause}; the plan on the vehicle may be incomplete",
        "Upload your plan again from the ground station before flying it.",
    )


def _same(one: Sequence[MissionItem], other: Sequence[MissionItem], home: int) -> bool:
    """Whether two plans are the same to the last bit, home apart."""
    if max(len(one), home) != max(len(other), home):  # a plan of only home, and none, are the same
        return False
    return all(a.same_as(b) for a, b in zip(one[home:], other[home:], strict=True))


def _arrived(read: MissionItem, sent: MissionItem) -> bool:
    """Whether the new waypoint was read back as sent, as far as both autopilots keep it."""
    return (
        read.command == sent.command
        and _PLAIN_FRAME.get(read.frame, read.frame) == _PLAIN_FRAME.get(sent.frame, sent.frame)
        and abs(read.x - sent.x) <= 1
        and abs(read.y - sent.y) <= 1
        and abs(read.z - sent.z) <= HEIGHT_TOLERANCE_M
    )
