"""Signs that the aircraft carries a gimbal, which a camera that is told as fixed must not sit on.

A stabilised camera whose attitude is taken for the aircraft's times a fixed mounting is answered some 30 per cent
wrong, and nothing looks wrong: in an out-and-back the bank is proportional to the way to the side, like parallax.

Sources: https://mavlink.io/en/services/gimbal_v2.html, MOUNT_ORIENTATION (265) and MOUNT_STATUS (158) of the older
protocol, ArduPilot's MNT1_TYPE and MNT2_TYPE, PX4's MNT_MODE_IN.
"""

from __future__ import annotations

from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.parameter_value import number_of
from mission.vehicle.state.modes import Autopilot

GIMBAL_MESSAGES: Final = (
    "GIMBAL_DEVICE_ATTITUDE_STATUS",
    "GIMBAL_DEVICE_INFORMATION",
    "GIMBAL_MANAGER_INFORMATION",
    "GIMBAL_MANAGER_STATUS",
    "MOUNT_ORIENTATION",
    "MOUNT_STATUS",
    "PARAM_VALUE",
)
"""Messages that `GimbalSigns.take` reads, besides heartbeats."""
_PARAMETERS: Final[dict[str, tuple[Autopilot, float]]] = {
    "MNT1_TYPE": ("ardupilot", 1.0),
    "MNT2_TYPE": ("ardupilot", 1.0),
    "MNT_MODE_IN": ("px4", 0.0),
}
"""The autopilot that has it, and the least value that means a gimbal."""
_SERVO: Final = 1.0


class GimbalSigns:
    """What was heard of a gimbal of one vehicle."""

    def __init__(self) -> None:
        self.sign = ""
        """The first sign, for the operator; empty while there is none."""
        self.servo = False
        """Whether the mount is of plain servos, which know no horizon and measure nothing."""

    def ask(self, link: MavlinkLink) -> None:
        """Ask what a gimbal would answer; nothing waits for that."""
        to = link.target_system, link.target_component
        for name in _PARAMETERS:
            link.send(mavlink.MAVLink_param_request_read_message(*to, name.encode(), -1))
        wanted = mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION
        request = mavlink.MAV_CMD_REQUEST_MESSAGE
        link.send(mavlink.MAVLink_command_long_message(*to, request, 0, wanted, 0, 0, 0, 0, 0, 0))

    def take(self, message: Any, system: int, autopilot: Autopilot) -> None:
        """Take in a heartbeat or one of `GIMBAL_MESSAGES`; called in the link's thread.

        Args:
            message: from the link.
            system: of the vehicle.
            autopilot: of the vehicle, which decides how its parameters are coded.
        """
        name = message.get_type()
        if message.get_srcSystem() != system:
            return
        if name == "PARAM_VALUE" and message.param_id == "MNT1_TYPE" and autopilot == "ardupilot":
            self.servo = number_of(message, autopilot) == _SERVO
        if self.sign:
            return
        if name == "HEARTBEAT":
            if message.type == mavlink.MAV_TYPE_GIMBAL:
                self.sign = f"component {message.get_srcComponent()} is a gimbal"
        elif name == "PARAM_VALUE":
            owner, least = _PARAMETERS.get(message.param_id, (None, 0.0))
            value = number_of(message, autopilot)
            if owner == autopilot and value is not None and value >= least:
                self.sign = f"{message.param_id} is {value:g}"
        elif name in GIMBAL_MESSAGES:
            self.sign = f"{name} is heard"
