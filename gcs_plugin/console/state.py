"""The state that pages are sent several times a second."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from gcs_plugin.console.desk import ConsoleDesk
from gcs_plugin.console.people import Lookout

_OLD_S: Final = 2.0


def state_json(desk: ConsoleDesk, lookout: Lookout, clock: Callable[[], float]) -> dict[str, object]:
    """Vehicle, video, flight and map; None for whatever is not known."""
    now_s, status, drawn, flight = clock(), desk.status, desk.scene.drawn(), desk.flight
    vehicle: dict[str, object] | None = None
    video: dict[str, object] | None = None
    if status is not None and now_s - status.t_s < _OLD_S:
        told = status.telemetry
        vehicle = {
            "name": status.name,
            "connected": told.connected,
            "armed": told.armed,
            "inAir": told.in_air,
            "mode": told.mode,
            "battery": told.battery_fraction,
            "height": told.height_m,
            "heading": None if told.heading_rad is None else round(math.degrees(told.heading_rad) % 360.0, 1),
            "poseRate": round(told.pose_rate_hz, 1),
            "loss": told.packet_loss,
        }
        if status.video is not None:
            video = {
                "state": status.video.state.value,
                "fps": round(status.video.fps, 1),
                "age": status.video.last_frame_age_s,
                "note": status.video.note or status.video.error,
            }
    craft = drawn.aircraft
    return {
        "vehicle": vehicle,
        "video": video,
        "busy": not desk.idle,
        "following": desk.following,
        "flight": {
            "stage": flight.stage,
            "text": flight.text,
            "for": round(now_s - flight.since_s, 1) if flight.stage else 0.0,
            "usual": flight.left_s,
        },
        "map": {
            "aircraft": None
            if craft is None
            else {
                "position": craft.position,
                "heading": _degrees(craft.heading_rad),
                "camera": _degrees(craft.camera_rad),
                "hfov": round(math.degrees(craft.hfov_rad), 1),
            },
            "path": drawn.path,
            "rays": drawn.rays,
            "fence": drawn.fence,
        },
        "people": {"picture": lookout.people.picture, "boxes": lookout.people.boxes},
    }


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else round(math.degrees(angle_rad) % 360.0, 1)
