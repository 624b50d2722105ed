"""What goes back over MAVLink: CAMERA_TRACKING_GEO_STATUS, the region of interest, and short texts for the operator."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, Final, Protocol

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from mission.errors import AnswerError, LinkError
from mission.geodesy import Geodetic, altitude_in, enu_to_geodetic
from mission.records import Estimate, GeodeticOrigin, Vector

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

TEXT_BYTES: Final = 50
"""Room for text in one STATUSTEXT."""
UNKNOWN: Final = math.nan
"""MAVLink's "not known" for floats."""
UNRESOLVED_SIGMAS: Final = 2.0
"""A speed below this many of its own sigmas has no course worth sending."""


class Inbox(Protocol):
    """Messages as they come (`mission.vehicle.mavlink.mailbox.Mailbox`)."""

    def get(self, timeout_s: float) -> Message | None:
        """The oldest one not taken yet, or None after a time without any."""
        ...


class Link(Protocol):
    """What publishing needs of `mission.vehicle.mavlink.link.MavlinkLink`."""

    target_system: int
    target_component: int
    source_system: int
    source_component: int

    def send(self, message: Message) -> None:
        """Send, without waiting."""
        ...

    def listen(self, *types: str) -> AbstractContextManager[Inbox]:
        """Collect messages of these types while the context lasts."""
        ...

    def command_int(self, command: int, params: Sequence[float], x: int, y: int, z: float, *, frame: int) -> int:
        """COMMAND_INT, repeated until it is answered: MAV_RESULT."""
        ...


def camera_tracking_geo_status(
    estimate: Estimate,
    origin: GeodeticOrigin,
    drone_enu_m: Vector | None,
    *,
    geoid_separation_m: float | None = None,
    home_amsl_m: float | None = None,
    status: int = mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE,
) -> Message:
    """The answer as CAMERA_TRACKING_GEO_STATUS (276).

    The message does not say what its accuracies are; as in PX4's and u-blox's reports they are one standard deviation:
    `h_acc` the root of the sum of the two horizontal variances, `v_acc` the vertical one's root, `vel_acc` the root of
    the sum of the three velocity variances. `hdg` is the target's course over ground, clockwise from north, with
    `hdg_acc` its standard deviation; `dist` the slant distance. What is not known is NaN: also `alt`, which is above
    mean sea level, where the origin's datum cannot be converted.

    Args:
        estimate: the answer.
        origin: of its local frame.
        drone_enu_m: where the drone is, shape (3,), or None.
        geoid_separation_m: ellipsoid height minus AMSL height, for an origin above the ellipsoid.
        home_amsl_m: home's height above mean sea level, for an origin above home.
        status: CAMERA_TRACKING_STATUS_FLAGS.
    """
    place = enu_to_geodetic(estimate.position_enu_m, origin)
    try:
        sea_m = altitude_in("amsl", place, geoid_separation_m=geoid_separation_m, home_amsl_m=home_amsl_m)
    except AnswerError:
        sea_m = UNKNOWN
    horizontal = vertical = rate = UNKNOWN
    if estimate.covariance is not None:
        variances = np.diag(estimate.covariance)
        horizontal = math.sqrt(variances[0] + variances[1])
        vertical = math.sqrt(variances[2])
        rate = math.sqrt(variances[3:6].sum()) if estimate.velocity_enu_m_s is not None else UNKNOWN
    east, north, up = (UNKNOWN,) * 3 if estimate.velocity_enu_m_s is None else estimate.velocity_enu_m_s.tolist()
    course, course_sigma = _course(estimate)
    return mavlink.MAVLink_camera_tracking_geo_status_message(
        tracking_status=status,
        lat=round(place.lat_deg * 1e7),
        lon=round(place.lon_deg * 1e7),
        alt=sea_m,
        h_acc=horizontal,
        v_acc=vertical,
        vel_n=north,
        vel_e=east,
        vel_d=-up,
        vel_acc=rate,
        dist=UNKNOWN if drone_enu_m is None else float(np.linalg.norm(estimate.position_enu_m - drone_enu_m)),
        hdg=course,
        hdg_acc=course_sigma,
    )


def set_region_of_interest(
    link: Link,
    place: Geodetic,
    *,
    geoid_separation_m: float | None = None,
    home_amsl_m: float | None = None,
) -> None:
    """Tell the autopilot to look at a place: DO_SET_ROI_LOCATION as COMMAND_INT, altitude above mean sea level.

    Always MAV_FRAME_GLOBAL: ArduPilot obeys the frame, PX4 takes the altitude as above mean sea level whatever the
    frame says, so this is the one way that means the same on both.

    Raises:
        AnswerError: the altitude cannot be converted, the autopilot refused, or nothing answered.
    """
    sea_m = altitude_in("amsl", place, geoid_separation_m=geoid_separation_m, home_amsl_m=home_amsl_m)
    try:
        result = link.command_int(
            mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
            (0.0, 0.0, 0.0, 0.0),
            round(place.lat_deg * 1e7),
            round(place.lon_deg * 1e7),
            sea_m,
            frame=mavlink.MAV_FRAME_GLOBAL,
        )
    except LinkError as error:
        raise AnswerError(f"The region of interest was not set: {error.cause}", error.remedy) from error
    if result != mavlink.MAV_RESULT_ACCEPTED:
        raise AnswerError(
            f"The autopilot did not take the region of interest: {enum_name('MAV_RESULT', result)}",
            "The geotag is stored; set the region of interest by hand if it is needed.",
        )


class StatusTexts:
    """Sends texts to the operator's ground station; long ones in chunks that it puts together."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._sent = 0

    def send(self, text: str, severity: int = mavlink.MAV_SEVERITY_INFO) -> None:
        """Send a text, shown at once.

        Args:
            text: the first 50 bytes are all that old ground stations show: the news come first.
            severity: MAV_SEVERITY.
        """
        text_id = 1 + self._sent % (2**16 - 1)
        self._sent += 1
        for message in statustexts(text, severity, text_id):
            self._link.send(message)


def statustexts(text: str, severity: int, text_id: int) -> list[Message]:
    """STATUSTEXT messages for a text: one with id 0 where it fits, else chunks with `text_id`.

    A null character ends the last chunk, so one that is full to the last byte is followed by an empty one.

    Raises:
        ValueError: the id is not in 1 to 65535.
    """
    if not 1 <= text_id < 2**16:
        raise ValueError("the id of a chunked text is 1 to 65535")
    plain = _plain(text)
    if len(plain) <= TEXT_BYTES:
        return [mavlink.MAVLink_statustext_message(severity, plain)]
    chunks = [plain[start : start + TEXT_BYTES] for start in range(0, len(plain), TEXT_BYTES)]
    if len(chunks[-1]) == TEXT_BYTES:
        chunks.append(b"")
    return [mavlink.MAVLink_statustext_message(severity, chunk, text_id, i) for i, chunk in enumerate(chunks[:256])]


def enum_name(enum: str, value: int) -> str:
    """The standard's name of an enum value, in lower case words."""
    entry = mavlink.enums[enum].get(value)
    if entry is None:
        return str(value)
    return str(entry.name).removeprefix(f"{enum}_").removeprefix("MAV_MISSION_").replace("_", " ").lower()


def _plain(text: str) -> bytes:
    """The text in ASCII, which every ground station shows (the standard's UTF-8 becomes boxes in several)."""
    spread = " ".join(text.replace("\0", " ").split())
    letters = "".join(c for c in unicodedata.normalize("NFKD", spread) if not unicodedata.combining(c))
    ascii_text = letters.encode("ascii", "replace").decode("ascii")
    return "".join(c if c.isprintable() else "?" for c in ascii_text).encode("ascii")


def _course(estimate: Estimate) -> tuple[float, float]:
    """Course over ground and its standard deviation, radians; NaN where the target may as well stand."""
    if estimate.velocity_enu_m_s is None or estimate.covariance is None:
        return UNKNOWN, UNKNOWN
    velocity = estimate.velocity_enu_m_s[:2]
    speed = float(np.hypot(*velocity))
    if speed == 0.0:
        return UNKNOWN, UNKNOWN
    along = velocity / speed
    across = np.array([along[1], -along[0]])
    covariance = estimate.covariance[3:5, 3:5]
    if speed < UNRESOLVED_SIGMAS * math.sqrt(along @ covariance @ along):
        return UNKNOWN, UNKNOWN
    sigma = math.sqrt(across @ covariance @ across) / speed
    # No direction is worse known than one taken at random.
    return math.atan2(velocity[0], velocity[1]) % (2.0 * math.pi), min(sigma, math.pi / math.sqrt(3.0))
