"""What stations ask a camera for: CAMERA_INFORMATION and its relatives, by message id or by older commands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component.identity import Identity
from gcs_plugin.component.video_stream import VideoStream, video_stream

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

REQUEST_COMMANDS: Final[dict[int, int]] = {
    mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION: mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_SETTINGS: mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS,
    mavlink.MAV_CMD_REQUEST_STORAGE_INFORMATION: mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
    mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION: mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION,
    mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_STATUS: mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
}
"""The commands of before MAV_CMD_REQUEST_MESSAGE, which QGroundControl still sends as well."""

CAMERA_FLAGS: Final[int] = (
    mavlink.CAMERA_CAP_FLAGS_CAPTURE_VIDEO
    | mavlink.CAMERA_CAP_FLAGS_HAS_TRACKING_POINT
    | mavlink.CAMERA_CAP_FLAGS_HAS_TRACKING_RECTANGLE
    | mavlink.CAMERA_CAP_FLAGS_HAS_TRACKING_GEO_STATUS
)
"""Captures video: QGroundControl shows its "Camera Tracking" switch only with a camera that captures video or photos
(`PhotoVideoControl.qml`)."""
_UNKNOWN: Final = math.nan
_FULL_HD_SENSOR_MM: Final = 6.17
"""Stands for the unknown width of the sensor; only its ratio to the focal length, the field of view, means anything."""


@dataclass(frozen=True, slots=True)
class Picture:
    """The camera's video as it is told to stations."""

    width_px: int
    height_px: int
    hfov_rad: float
    url: str
    """The video's address, as FFmpeg opens it."""
    framerate_hz: float = 0.0
    codec: str = ""
    """FFmpeg's name for it; empty before the video was opened."""

    @property
    def stream(self) -> VideoStream | None:
        """What stations are told of it; None where they could not open it."""
        return video_stream(self.url, self.codec)


def information(message_id: int, identity: Identity, picture: Picture, boot_ms: int) -> Message | None:
    """The message with this id, or None when the component has no such message.

    Args:
        message_id: of MAVLink.
        identity: the component's.
        picture: the camera's video.
        boot_ms: since the component started.
    """
    match message_id:
        case mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION:
            return _camera_information(identity, picture, boot_ms)
        case mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION:
            stream = picture.stream
            if stream is None:
                return None
            return mavlink.MAVLink_video_stream_information_message(
                1,
                1,
                stream.kind,
                mavlink.VIDEO_STREAM_STATUS_FLAGS_RUNNING,
                picture.framerate_hz,
                picture.width_px,
                picture.height_px,
                0,
                0,
                round(math.degrees(picture.hfov_rad)),
                b"sidestep",
                stream.uri.encode(),
                stream.encoding,
            )
        case mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS if picture.stream is not None:
            return mavlink.MAVLink_video_stream_status_message(
                1,
                mavlink.VIDEO_STREAM_STATUS_FLAGS_RUNNING,
                picture.framerate_hz,
                picture.width_px,
                picture.height_px,
                0,
                0,
                round(math.degrees(picture.hfov_rad)),
            )
        case mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS:
            return mavlink.MAVLink_camera_settings_message(boot_ms, mavlink.CAMERA_MODE_VIDEO, _UNKNOWN, _UNKNOWN)
        case mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS:
            return mavlink.MAVLink_camera_capture_status_message(boot_ms, 0, 0, 0.0, 0, 0.0, 0)
        case mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION:
            return mavlink.MAVLink_storage_information_message(
                boot_ms, 1, 1, mavlink.STORAGE_STATUS_NOT_SUPPORTED, 0.0, 0.0, 0.0, 0.0, 0.0
            )
        case mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return mavlink.MAVLink_autopilot_version_message(
                identity.capabilities, identity.version_number, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0
            )
    return None


def _camera_information(identity: Identity, picture: Picture, boot_ms: int) -> Message:
    focal_mm = _FULL_HD_SENSOR_MM / (2.0 * math.tan(picture.hfov_rad / 2.0))
    return mavlink.MAVLink_camera_information_message(
        boot_ms,
        _text("Sidestep", 32),
        _text("Person locator", 32),
        # Vendors' own order: patch, minor, major from the highest byte down to the lowest.
        int.from_bytes(identity.version_number.to_bytes(4, "big")[:3][::-1], "big"),
        focal_mm,
        _FULL_HD_SENSOR_MM,
        _FULL_HD_SENSOR_MM * picture.height_px / picture.width_px,
        picture.width_px,
        picture.height_px,
        0,
        CAMERA_FLAGS | (0 if picture.stream is None else mavlink.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM),
        0,
        b"",
    )


def _text(text: str, size: int) -> list[int]:
    return list(text.encode("ascii", "replace")[: size - 1].ljust(size, b"\0"))
