"""The AR.Drone as the entry point `sidestep.drones` offers it."""

from __future__ import annotations

from pathlib import Path

from mission.camera.camera import Camera
from mission.errors import SettingsError
from mission.vehicle.ardrone.ardrone import ARDrone
from mission.vehicle.limits import FlightSettings


def make(
    url: str, *, flight: FlightSettings | None = None, pilot_log: Path | None = None, camera: Camera | None = None
) -> ARDrone:
    """An AR.Drone 2.0, not yet connected.

    Args:
        url: ``ardrone://HOST?...``, see `mission.vehicle.ardrone.url`.
        flight: limits of the pilot process.
        pilot_log: file for the pilot process's own log.
        camera: the one that it carries.

    Raises:
        SettingsError: the address is none, or the camera is told to be on a gimbal.
    """
    if camera is not None and camera.gimbal == "mavlink":
        raise SettingsError("an AR.Drone's camera is fixed, its camera file says gimbal", 'Say gimbal = "none".')
    return ARDrone(url, flight=flight, pilot_log=pilot_log)
