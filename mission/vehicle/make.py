"""The aircraft behind an address: by its scheme one that an installed package offers, else a MAVLink vehicle.

Packages offer aircraft by the entry point group `sidestep.drones`: the name is the scheme of their addresses, the
object is called with the address, `flight`, `pilot_log` and `camera`, and returns a `Drone`, not yet connected.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path as FilePath

from mission.camera.camera import Camera
from mission.vehicle.drone import Drone
from mission.vehicle.limits import FlightSettings
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.mavlink_drone import MavlinkDrone

DRONES = "sidestep.drones"
"""The entry points of aircraft."""


def make_drone(
    url: str,
    *,
    target_system: int = 0,
    flight: FlightSettings | None = None,
    pilot_log: FilePath | None = None,
    sparing: bool = False,
    camera: Camera | None = None,
) -> Drone:
    """An aircraft, not yet connected.

    Args:
        url: ``ardrone://HOST``, another scheme of `sidestep.drones`, or a MAVLink address.
        target_system: a MAVLink vehicle's system id; 0 takes the first that is heard.
        flight: limits of the pilot process.
        pilot_log: file for the pilot process's own log.
        sparing: whether little is decoded while nobody looks; for programs that wait long.
        camera: the one that it carries; tells whether a gimbal's attitude is wanted.

    Raises:
        SettingsError: the address is none, or the aircraft cannot have such a camera.
    """
    for entry in entry_points(group=DRONES, name=url.partition("://")[0].lower()):
        drone: Drone = entry.load()(url, flight=flight, pilot_log=pilot_log, camera=camera)
        return drone
    on_gimbal = camera is not None and camera.gimbal == "mavlink"
    return MavlinkDrone(
        url,
        target_system=target_system,
        flight=flight,
        pilot_log=pilot_log,
        sparing=sparing,
        gimbal_age_s=camera.gimbal_age_s if camera is not None and on_gimbal else None,
    )


def mavlink_of(drone: Drone) -> MavlinkLink | None:
    """The program's MAVLink side of a connected aircraft; None for one that does not speak MAVLink.

    Raises:
        LinkError: not connected.
    """
    return drone.link if isinstance(drone, MavlinkDrone) else None
