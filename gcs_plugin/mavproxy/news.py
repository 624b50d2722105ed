"""What the camera component has said: whether it is there, what it tracks, its texts, and where the last target is."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.mavproxy.arguments import PictureSize
from gcs_plugin.publish.messages import TEXT_BYTES

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

SILENT_S: Final = 5.0
"""Without a heartbeat for this long it is gone (as in QGroundControl)."""
_MOST_CHUNKS: Final = 16
_RESULT: Final = re.compile(r"target (\d+): ")


@dataclass(frozen=True, slots=True)
class Fix:
    """Where the last target is, from CAMERA_TRACKING_GEO_STATUS."""

    lat_deg: float
    lon_deg: float
    horizontal_sigma_m: float
    """Root of the sum of both horizontal variances; NaN when it is not known."""
    speed_m_s: float
    """Horizontal; NaN when it is not known."""


class News:
    """Kept up to date by the messages of one component.

    Times are whatever clock the caller uses, in seconds.
    """

    def __init__(self) -> None:
        self.heard_s: float | None = None
        """Time of the last heartbeat."""
        self.picture: PictureSize | None = None
        self.tracking = False
        self.fix: Fix | None = None
        self.number: int | None = None
        """Of the last target, in the log."""
        self.text = ""
        """The last thing that it said."""
        self._chunks: dict[int, dict[int, str]] = {}

    def present(self, now_s: float) -> bool:
        """Whether it has been heard lately."""
        return self.heard_s is not None and now_s - self.heard_s < SILENT_S

    def take(self, message: Message, now_s: float) -> str:
        """Learn from a message. Returns a whole text for the operator when it ends one, else an empty one."""
        match message.get_type():
            case "HEARTBEAT":
                self.heard_s = now_s
            case "CAMERA_TRACKING_IMAGE_STATUS":
                self.tracking = message.tracking_status == mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE
            case "CAMERA_TRACKING_GEO_STATUS":
                self._geo_status(message)
            case "VIDEO_STREAM_INFORMATION" | "CAMERA_INFORMATION":
                self._picture(message)
            case "STATUSTEXT":
                return self._statustext(message)
        return ""

    def _geo_status(self, message: Message) -> None:
        lat_deg, lon_deg = message.lat / 1e7, message.lon / 1e7
        if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0) or (message.lat, message.lon) == (0, 0):
            return
        sigma = float(message.h_acc)
        self.fix = Fix(
            lat_deg,
            lon_deg,
            sigma if sigma > 0.0 and math.isfinite(sigma) else math.nan,
            math.hypot(message.vel_n, message.vel_e),
        )

    def _picture(self, message: Message) -> None:
        width, height = int(message.resolution_h), int(message.resolution_v)
        if width > 0 and height > 0:
            self.picture = PictureSize(width, height)

    def _statustext(self, message: Message) -> str:
        text = message.text if isinstance(message.text, str) else message.text.decode("ascii", "replace")
        text = text.split("\0")[0]
        if message.id:
            if message.chunk_seq == 0:
                self._chunks.clear()  # one at a time: a text that lost its end is given up with the next one
            chunks = self._chunks.setdefault(message.id, {})
            if message.chunk_seq >= _MOST_CHUNKS or len(self._chunks) > 1:
                self._chunks.clear()
                return ""
            chunks[message.chunk_seq] = text
            if len(text) == TEXT_BYTES:
                return ""
            text = "".join(chunks.get(i, "...") for i in range(message.chunk_seq + 1))
            self._chunks.clear()
        self.text = "".join(c if c.isprintable() else "?" for c in text)
        if found := _RESULT.match(self.text):
            self.number = int(found[1])
        return self.text
