"""A simulated MAVLink autopilot: PX4 or ArduPilot Copter in what MAVSDK and pymavlink use.

    autopilot = start_autopilot(AutopilotConfig(flavour="px4", noise="good", seed=1), ring.name)
    drone = MavlinkDrone(autopilot.url)
    ...
    autopilot.stop()

It flies RotorPy's multirotor on an estimate with errors as measured on real builds; see `estimate_errors`.
"""

from sitl.autopilot.airframe import Wind
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flavour import Mode
from sitl.autopilot.process import AutopilotProcess, start_autopilot

__all__ = ["AutopilotConfig", "AutopilotProcess", "Mode", "Wind", "start_autopilot"]
