"""Who the component is: the vehicle's system id, a camera's component id, a name and a version."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from pymavlink.dialects.v20 import all as mavlink

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

HEARTBEAT_S: Final = 1.0
_MAVLINK_VERSION: Final = 3

ParameterEncoding = Literal["c-cast", "bytewise"]
"""How an integer travels in the float of PARAM_VALUE: as its value, or as its bytes."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The component on the link."""

    system: int
    component: int = mavlink.MAV_COMP_ID_CAMERA
    encoding: ParameterEncoding = "bytewise"
    version: str = "0"
    instance: int = 0x51DE57E9
    """Of this run, 32 bits: stands in our heartbeat, where a camera's `custom_mode` means nothing."""

    @property
    def version_number(self) -> int:
        """Major, minor, patch and 255 (a release) in the four bytes from the highest."""
        parts = [int(part) if part.isdigit() else 0 for part in self.version.split(".")[:3]]
        major, minor, patch = (*parts, 0, 0, 0)[:3]
        return (major & 255) << 24 | (minor & 255) << 16 | (patch & 255) << 8 | 255

    @property
    def capabilities(self) -> int:
        """MAV_PROTOCOL_CAPABILITY."""
        encoding = (
            mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
            if self.encoding == "c-cast"
            else mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        )
        return int(mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2 | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT | encoding)


def heartbeat(identity: Identity, *, busy: bool) -> Message:
    """HEARTBEAT of a camera: standing by, or active while an order runs."""
    state = mavlink.MAV_STATE_ACTIVE if busy else mavlink.MAV_STATE_STANDBY
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID, 0, identity.instance, state, _MAVLINK_VERSION
    )
