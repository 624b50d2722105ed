"""COMMAND_CANCEL (80), which the MAVLink standard has and pymavlink's dialects have not: made known here.

https://mavlink.io/en/messages/common.html#COMMAND_CANCEL
"""

from __future__ import annotations

import struct
from typing import ClassVar, Final

from pymavlink.dialects.v20 import all as mavlink

COMMAND_CANCEL: Final = 80


class CommandCancel(mavlink.MAVLink_message):  # type: ignore[misc]  # pymavlink is untyped
    """End a command that takes long; its own COMMAND_ACK then says cancelled.

    Args:
        target_system: of the component that carries it out.
        target_component: that component.
        command: MAV_CMD to cancel.
    """

    id = COMMAND_CANCEL
    msgname = "COMMAND_CANCEL"
    fieldnames: ClassVar[list[str]] = ["target_system", "target_component", "command"]
    ordered_fieldnames: ClassVar[list[str]] = ["command", "target_system", "target_component"]
    fieldtypes: ClassVar[list[str]] = ["uint8_t", "uint8_t", "uint16_t"]
    fielddisplays_by_name: ClassVar[dict[str, str]] = {}
    fieldenums_by_name: ClassVar[dict[str, str]] = {"command": "MAV_CMD"}
    fieldunits_by_name: ClassVar[dict[str, str]] = {}
    native_format = bytearray(b"<HBB")
    orders: ClassVar[list[int]] = [1, 2, 0]
    lengths: ClassVar[list[int]] = [1, 1, 1]
    array_lengths: ClassVar[list[int]] = [0, 0, 0]
    crc_extra = 14
    unpacker = struct.Struct("<HBB")
    instance_field = None
    instance_offset = -1

    def __init__(self, target_system: int, target_component: int, command: int) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = self.fieldnames
        self._instance_field = self.instance_field
        self._instance_offset = self.instance_offset
        self.target_system = target_system
        self.target_component = target_component
        self.command = command

    def pack(self, mav: mavlink.MAVLink, force_mavlink1: bool = False) -> bytes:
        """Its bytes."""
        payload = self.unpacker.pack(self.command, self.target_system, self.target_component)
        return bytes(self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1))


mavlink.mavlink_map.setdefault(COMMAND_CANCEL, CommandCancel)
