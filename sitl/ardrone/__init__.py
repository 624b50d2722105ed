"""A simulated Parrot AR.Drone 2.0: AT commands, navdata, configuration, video, and an aircraft that drifts.

Written from the public description of the protocol, independently of `mission.vehicle.ardrone`, which flies it.
"""

from sitl.ardrone.config import ArdroneConfig, config_of
from sitl.ardrone.process import ArdroneProcess, ardrone_url, start_ardrone

__all__ = ["ArdroneConfig", "ArdroneProcess", "ardrone_url", "config_of", "start_ardrone"]
