"""Notices another component that speaks under our ids: another camera, or a second `sidestep serve`.

Stations cannot tell the two apart, so that a box drawn for the other one comes here as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from gcs_plugin.component.identity import Identity

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

GONE_S: Final = 10.0
"""After this time without a heartbeat the other one is gone."""
AGAIN_S: Final = 60.0
"""Between two texts as long as it is there."""


class Namesake:
    """Whether somebody else has our ids.

    Args:
        identity: ours; its `instance` tells our own heartbeats from others', should the network bring them back.
        say: tells the operator.
    """

    def __init__(self, identity: Identity, say: Callable[[str], None]) -> None:
        self._identity = identity
        self._say = say
        self._heard_s = -math.inf
        self._said_s = -math.inf

    def hear(self, message: Message, now_s: float) -> None:
        """Look at a HEARTBEAT."""
        own = self._identity
        if (message.get_srcSystem(), message.get_srcComponent()) != (own.system, own.component):
            return
        if message.custom_mode == own.instance:
            return
        if not self.present(now_s) or now_s - self._said_s >= AGAIN_S:
            self._said_s = now_s
            self._say(
                f"another component has our id {own.system}/{own.component}: boxes and points are refused; "
                "set orders.component to a free camera id"
            )
        self._heard_s = now_s

    def present(self, now_s: float) -> bool:
        """Whether it was heard of late."""
        return now_s - self._heard_s < GONE_S
