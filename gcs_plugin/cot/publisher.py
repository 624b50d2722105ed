"""Keeps the targets and the drone on everybody's map: sends each at once, and again until it is stale."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Final

from gcs_plugin.cot.event import DroneState, drone_event, ellipse_event, target_event
from gcs_plugin.cot.sender import CotSender, cot_sender
from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.words import moves
from mission.camera import Camera
from mission.geodesy import altitude_in, enu_to_geodetic
from mission.settings import MissionSettings, TakSettings
from mission.vehicle.drone import Drone

DRONE_PERIOD_S: Final = 1.0
_POSE_AGE_S: Final = 0.3
_TARGETS: Final = 50
"""That are sent again and again; older ones stay on the maps until they are stale."""


@dataclass(slots=True)
class _Shown:
    geotag: Geotag
    until: datetime
    next_s: float


class TakPublisher:
    """Publishes to all addresses of the settings. Use as a context, or close it.

    Args:
        settings: addresses, stale times, conventions.
        camera: what the drone's field of view follows from.
        drone_name: tells this aircraft from others of the same callsign.
        clock: monotonic seconds.
        utc: the present time.
        senders: for tests; those of the settings without them.

    Raises:
        SettingsError: an address cannot be used.
        ModuleNotFoundError: the extra [tak] is not installed, and an address is a server's.
    """

    def __init__(
        self,
        settings: TakSettings,
        camera: Camera,
        drone_name: str,
        clock: Callable[[], float] = time.monotonic,
        utc: Callable[[], datetime] = lambda: datetime.now(UTC),
        senders: Sequence[CotSender] | None = None,
    ) -> None:
        self._settings = settings
        self._camera = camera
        self._clock = clock
        self._utc = utc
        self._uid = f"sidestep.{settings.callsign}.{drone_name}"
        self._senders = list(senders) if senders is not None else [cot_sender(u, settings) for u in settings.urls]
        self._shown: dict[str, _Shown] = {}
        self._lock = threading.Lock()
        self._news = threading.Event()
        self._ended = False
        self._next_drone_s = -math.inf
        self._thread = threading.Thread(target=self._repeat, name="tak", daemon=True)
        self._thread.start()

    def target(self, geotag: Geotag) -> None:
        """Show a target; an earlier answer for the same one is replaced."""
        stale_s = self._settings.stale_moving_s if moves(geotag) else self._settings.stale_s
        shown = _Shown(geotag, geotag.time_utc + timedelta(seconds=stale_s), self._clock() + self._settings.repeat_s)
        with self._lock:
            self._shown[geotag.id] = shown
            while len(self._shown) > _TARGETS:
                del self._shown[next(iter(self._shown))]
        self._send(geotag)
        self._news.set()

    def drone(self, drone: Drone) -> None:
        """Show the drone, when it is time to again; to be called often, from the thread that may ask it."""
        now_s = self._clock()
        if not self._settings.drone or now_s < self._next_drone_s:
            return
        self._next_drone_s = now_s + DRONE_PERIOD_S
        state = drone_state(drone, self._camera, self._uid, self._settings.callsign, now_s)
        if state is not None:
            self._put(drone_event(state, self._utc()))

    def close(self) -> None:
        """Send nothing more. Safe to call twice."""
        self._ended = True
        self._news.set()
        self._thread.join()
        for sender in self._senders:
            sender.close()

    def _repeat(self) -> None:
        while not self._ended:
            now, now_s = self._utc(), self._clock()
            with self._lock:
                for name in [name for name, shown in self._shown.items() if now >= shown.until]:
                    del self._shown[name]
                due = [shown for shown in self._shown.values() if now_s >= shown.next_s]
                for shown in due:
                    shown.next_s = now_s + self._settings.repeat_s
                next_s = min((shown.next_s for shown in self._shown.values()), default=math.inf)
            for shown in due:
                self._send(shown.geotag)
            self._news.wait(None if math.isinf(next_s) else max(next_s - self._clock(), 0.0))
            self._news.clear()

    def _send(self, geotag: Geotag) -> None:
        now = self._utc()
        self._put(target_event(geotag, self._settings, now, self._uid))
        self._put(ellipse_event(geotag, self._settings, now))

    def _put(self, event: bytes) -> None:
        for sender in self._senders:
            sender.send(event)


def tak_publisher(settings: MissionSettings, camera: Camera) -> TakPublisher | None:
    """What the settings ask for; None where they name no address.

    Raises:
        SettingsError: an address cannot be used.
        ModuleNotFoundError: the extra [tak] is not installed, and an address is a server's.
    """
    return TakPublisher(settings.tak, camera, str(settings.link.system)) if settings.tak.urls else None


def drone_state(drone: Drone, camera: Camera, uid: str, callsign: str, now_s: float) -> DroneState | None:
    """Where the drone is and looks; None while it has no place on the earth."""
    pose, origin = drone.pose_at(now_s - _POSE_AGE_S), drone.origin
    if pose is None or origin is None:
        return None
    telemetry = drone.telemetry()
    place = enu_to_geodetic(pose.position_enu_m, origin)
    height_m = None
    if place.datum == "ellipsoid" or (place.datum == "amsl" and telemetry.geoid_separation_m is not None):
        height_m = altitude_in("ellipsoid", place, geoid_separation_m=telemetry.geoid_separation_m)
    east, north, _ = pose.velocity_enu_m_s.tolist()
    lens = camera.intrinsics
    forward, right, down = camera.mounting.body_from_camera.apply([0.0, 0.0, 1.0]).tolist()
    heading = telemetry.heading_rad
    return DroneState(
        uid=uid,
        callsign=callsign,
        place=place,
        ellipsoid_height_m=height_m,
        course_rad=math.atan2(east, north) if east or north else None,
        speed_m_s=math.hypot(east, north),
        heading_rad=None if heading is None else heading + math.atan2(right, forward),
        hfov_rad=2.0 * math.atan(lens.width_px / (2.0 * lens.fx)),
        tilt_down_rad=math.atan2(down, math.hypot(forward, right)),
    )
