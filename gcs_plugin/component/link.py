"""The vehicle's link as the component uses it: everything goes out under the component's id."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, Final

from gcs_plugin.publish.messages import Inbox
from mission.vehicle.mavlink.link import Gate, MavlinkLink

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

INBOX_SIZE: Final = 500
"""When more come in one turn of the loop, the oldest are lost."""


class StationLink:
    """`gcs_plugin.publish.messages.Link` that speaks as one component of the vehicle.

    Args:
        link: the vehicle's, which also others use.
        component: our component id.
    """

    def __init__(self, link: MavlinkLink, component: int) -> None:
        self._link = link
        self.answer: Message | None = None
        """The newest CAMERA_TRACKING_GEO_STATUS that was sent."""
        self.target_system = link.target_system
        self.target_component = link.target_component
        self.source_system = link.source_system
        self.source_component = component

    def send(self, message: Message) -> None:
        """Send, without waiting."""
        self._link.send(message, source_component=self.source_component)
        if message.get_type() == "CAMERA_TRACKING_GEO_STATUS":
            self.answer = message

    def listen(self, *types: str, gate: Gate | None = None) -> AbstractContextManager[Inbox]:
        """Collect messages of these types while the context lasts; see `MavlinkLink.listen`."""
        return self._link.listen(*types, size=INBOX_SIZE, gate=gate)

    def command_int(self, command: int, params: Sequence[float], x: int, y: int, z: float, *, frame: int) -> int:
        """COMMAND_INT, repeated until it is answered: MAV_RESULT."""
        return self._link.command_int(command, params, x, y, z, frame=frame, source_component=self.source_component)
