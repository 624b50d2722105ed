"""The aircraft behind an address: an AR.Drone for ``ardrone://``, a MAVLink vehicle for all others."""

from __future__ import annotations

from pathlib import Path as FilePath

from mission.camera.camera import Camera
from mission.errors import SettingsError
from mission.vehicle.ardrone.ardrone import ARDrone
from mission.vehicle.ardrone.url import is_ardrone
from mission.vehicle.limits import FlightSettings
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.mavlink_drone import MavlinkDrone

AnyDrone = MavlinkDrone | ARDrone
"""Every aircraft that there is; all are `mission.vehicle.drone.Drone`."""


def make_drone(
    url: str,
    *,
    target_system: int = 0,
    flight: FlightSettings | None = None,
    pilot_log: FilePath | None = None,
    sparing: bool = False,
    camera: Camera | None = None,
) -> AnyDrone:
    """An aircraft, not yet connected.

    Args:
        url: ``ardrone://HOST`` (`mission.vehicle.ardrone.url`) or a MAVLink address (`mission.vehicle.mavlink.url`).
        target_system: a MAVLink vehicle's system id; 0 takes the first that is heard.
        flight: limits of the pilot process.
        pilot_log: file for the pilot process's own log.
        sparing: whether little is decoded while nobody looks; for programs that wait long.
        camera: the one that it carries; tells whether a gimbal's attitude is wanted.

    Raises:
        SettingsError: the address is none, or the aircraft cannot have such a camera.
    """
    on_gimbal = camera is not None and camera.gimbal == "mavlink"
    if is_ardrone(url):
        if on_gimbal:
            raise SettingsError("an AR.Drone's camera is fixed, its camera file says gimbal", 'Say gimbal = "none".')
        return ARDrone(url, flight=flight, pilot_log=pilot_log)
    return MavlinkDrone(
        url,
        target_system=target_system,
        flight=flight,
        pilot_log=pilot_log,
        sparing=sparing,
        gimbal_age_s=camera.gimbal_age_s if camera is not None and on_gimbal else None,
    )


def mavlink_of(drone: AnyDrone) -> MavlinkLink | None:
    """The program's MAVLink side of a connected aircraft; None for one that does not speak MAVLink.

    Raises:
        LinkError: not connected.
    """
    return drone.link if isinstance(drone, MavlinkDrone) else None
