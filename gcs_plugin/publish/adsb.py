"""A target as ADSB_VEHICLE, the only marker that all three ground stations draw.

Autopilots feed ADSB_VEHICLE to their traffic avoidance, so it goes to a ground station's own address and never to the
vehicle's link; where an autopilot is heard at that address, nothing is sent.
"""

from __future__ import annotations

import logging
import math
import socket
import threading
import time
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.geotags.geotag import Geotag
from mission.errors import SettingsError
from mission.vehicle.mavlink.framing import decode, frames

_LOG = logging.getLogger(__name__)

PERIOD_S: Final = 1.0
"""Between repetitions; MAVProxy drops a marker after 5 s without."""
LISTEN_S: Final = 1.5
"""Before the first marker; autopilots send their heartbeat once a second to whoever speaks to them."""
_FIRST_ADDRESS: Final = 0xFF0000
_ADDRESSES: Final = 0x10000
_LARGEST_DATAGRAM: Final = 65535


def adsb_vehicle(geotag: Geotag, age_s: float) -> Any:
    """A geotag as ADSB_VEHICLE (246).

    The address and the callsign (``TGT`` and the number) follow from the geotag's number, so that a target keeps its
    marker. The altitude is above mean sea level; it, speed and course are flagged as valid only where they are known.

    Args:
        geotag: logged, so that it has a number.
        age_s: time since its position held.
    """
    flags = mavlink.ADSB_FLAGS_VALID_COORDS | mavlink.ADSB_FLAGS_VALID_CALLSIGN
    altitude_m, speed_m_s, course_rad = geotag.amsl_m, geotag.speed_m_s, geotag.course_rad
    if altitude_m is not None:
        flags |= mavlink.ADSB_FLAGS_VALID_ALTITUDE
    if speed_m_s is not None and course_rad is not None:
        flags |= mavlink.ADSB_FLAGS_VALID_VELOCITY | mavlink.ADSB_FLAGS_VALID_HEADING
    return mavlink.MAVLink_adsb_vehicle_message(
        ICAO_address=_FIRST_ADDRESS + geotag.number % _ADDRESSES,
        lat=round(geotag.place.lat_deg * 1e7),
        lon=round(geotag.place.lon_deg * 1e7),
        altitude_type=mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC,
        altitude=round(1000.0 * (altitude_m or 0.0)),
        heading=round(100.0 * math.degrees(course_rad or 0.0)) % 36000,
        hor_velocity=min(round(100.0 * (speed_m_s or 0.0)), 65535),
        ver_velocity=0,
        callsign=f"TGT{geotag.number % 100_000}".encode("ascii"),
        emitter_type=mavlink.ADSB_EMITTER_TYPE_NO_INFO,
        tslc=max(0, min(round(age_s), 255)),
        flags=flags,
        squawk=0,
    )


class AdsbMirror:
    """Shows one target to a ground station for a while, from a thread of its own that ends with that while.

    Args:
        url: the ground station's address, ``udpout://HOST:PORT``.
        geotag: the target.
        lifetime_s: how long it is shown.
        system: our system id.
        component: our component id.
        clock: monotonic seconds.
        listen_s: how long to listen for an autopilot before the first marker.

    Raises:
        SettingsError: the address is none.
    """

    def __init__(
        self,
        url: str,
        geotag: Geotag,
        lifetime_s: float,
        *,
        system: int,
        component: int,
        clock: Callable[[], float] = time.monotonic,
        listen_s: float = LISTEN_S,
    ) -> None:
        self._geotag = geotag
        self._clock = clock
        self._shown_s = clock()
        self._lifetime_s = lifetime_s
        self._listen_s = listen_s
        self._packer = mavlink.MAVLink(None, system, component)
        self._parser = mavlink.MAVLink(None)
        self._ended = threading.Event()
        self._socket = _connected(url)
        self.autopilot_heard = False
        """Whether it has ended because an autopilot is at that address."""
        self._thread = threading.Thread(target=self._run, name="adsb-mirror", daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether the target is still shown."""
        return self._thread.is_alive()

    def close(self) -> None:
        """End it now. Safe to call twice."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        with self._socket:
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
                    mavlink.MAV_AUTOPILOT_INVALID,
                    0,
                    0,
                    mavlink.MAV_STATE_ACTIVE,
                    3,
                )
            )
            self._ended.wait(self._listen_s)
            while not self._ended.is_set():
                age_s = self._clock() - self._shown_s
                if age_s > self._lifetime_s:
                    return
                if self._hears_an_autopilot():
                    self.autopilot_heard = True
                    _LOG.warning("an autopilot is at the address for ADSB markers; no marker is sent")
                    return
                self._send(adsb_vehicle(self._geotag, age_s))
                self._ended.wait(PERIOD_S)

    def _send(self, message: Any) -> None:
        data = message.pack(self._packer)
        self._packer.seq = (self._packer.seq + 1) % 256
        try:
            self._socket.send(data)
        except OSError as error:  # nobody listens there at the moment
            _LOG.debug("ADSB mirror: %s", error)

    def _hears_an_autopilot(self) -> bool:
        while True:
            try:
                data = self._socket.recv(_LARGEST_DATAGRAM)
            except OSError:  # nothing more, or nobody listens there at the moment
                return False
            for message_id, frame in frames(data):
                if message_id != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                    continue
                message = decode(self._parser, frame)
                if message is not None and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                    return True


def _connected(url: str) -> socket.socket:
    scheme, _, address = url.partition("://")
    host, _, port = address.rpartition(":")
    if scheme not in ("udp", "udpout") or not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise SettingsError(f"{url!r} is not the address of a ground station", "Give udpout://HOST:PORT.")
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.connect((host, int(port)))
    except OSError as error:
        sock.close()
        raise SettingsError(f"the ground station {url!r} cannot be reached: {error}", "Check host and port.") from error
    sock.setblocking(False)
    return sock
