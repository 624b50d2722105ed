"""The autopilot's peers: a `Link` to each, what goes out on it unasked, and forwarding between them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot import telemetry
from sitl.autopilot.flight_stack import FlightStack
from sitl.autopilot.link import Link
from sitl.autopilot.plan import PlanTransfer

_PARAMETERS_PER_TICK = 2


class Peers:
    """All that an autopilot talks to.

    Args:
        stack: whose messages are sent.
        radio: decides which packets are lost.
    """

    def __init__(self, stack: FlightStack, radio: np.random.Generator) -> None:
        self._stack, self._radio = stack, radio
        self.links: list[Link] = []
        self._transfers: dict[int, PlanTransfer] = {}
        self._dumps: dict[int, int] = {}
        self._shown = (stack.commander.mode, False)
        self._commands_gimbal = (0, 0)

    def add(self, write: Callable[[bytes], None]) -> Link:
        """A new peer; `write` gets every packet for it."""
        stack = self._stack
        rates = dict(stack.flavour.default_rates)
        if stack.gimbal is not None:
            rates |= telemetry.GIMBAL_HZ[stack.flavour.name]
        link = Link(write, stack.config.system_id, rates, self._radio)
        self.links.append(link)
        self._transfers[id(link)] = PlanTransfer(stack.plan)
        return link

    def remove(self, link: Link) -> None:
        """The peer is gone."""
        self.links.remove(link)
        self._transfers.pop(id(link), None)
        self._dumps.pop(id(link), None)

    def send_all(self, message: Any) -> None:
        """To every peer."""
        for link in self.links:
            link.send(message)

    def plan_message(self, link: Link, message: Any) -> None:
        """A message of the mission protocol."""
        for answer in self._transfers[id(link)].handle(message, self._stack.now, self._stack.home_item()):
            link.send(answer)

    def dump_parameters(self, link: Link) -> None:
        """Start sending all parameters, a few each tick."""
        self._dumps[id(link)] = 0

    def route(self, link: Link, message: Any) -> bool:
        """Forward between peers as the MAVLink routing rules say; whether the message is also for us."""
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        ours = self._stack.config.system_id
        source = (message.get_srcSystem(), message.get_srcComponent())
        for other in self.links:
            if other is link or source in other.seen:
                continue
            known = any(s == system and component in (0, c) for s, c in other.seen)
            if system == 0 or known:
                other.forward(message.get_msgbuf())
        if system not in (0, ours):
            return False
        elsewhere = any((ours, component) in other.seen for other in self.links)
        return component in (0, mavlink.MAV_COMP_ID_AUTOPILOT1) or not elsewhere

    def transmit(self) -> None:
        """Send what is due."""
        stack = self._stack
        while stack.commander.texts:
            severity, text = stack.commander.texts.popleft()
            self.send_all(mavlink.MAVLink_statustext_message(severity, text[:50].encode()))
        shown = (stack.commander.mode, stack.commander.armed)
        if shown != self._shown and stack.flavour.name == "ardupilot":
            self.send_all(telemetry.heartbeat(stack))  # PX4 leaves it at 1 Hz: a take-over is seen late there
        if shown != self._shown:
            for link in self.links:
                for message_id in stack.flavour.slow_hz.keys() & link.intervals.keys():
                    link.send(telemetry.build(stack, message_id))
        self._shown = shown
        reached, stack.plan.reached = stack.plan.reached, None
        if reached is not None:
            self.send_all(mavlink.MAVLink_mission_item_reached_message(reached))
        if stack.gimbal is not None and stack.gimbal.primary != self._commands_gimbal:
            self._commands_gimbal = stack.gimbal.primary
            self.send_all(telemetry.gimbal_manager_status(stack))
        for link in self.links:
            for message_id in link.due(stack.now):
                message = None if telemetry.silent(stack, message_id) else telemetry.build(stack, message_id)
                if message is not None:
                    link.send(message)
            for answer in self._transfers[id(link)].step(stack.now):
                link.send(answer)
            self._dump(link)

    def _dump(self, link: Link) -> None:
        parameters, index = self._stack.parameters, self._dumps.get(id(link))
        if index is None:
            return
        for at in range(index, min(index + _PARAMETERS_PER_TICK, len(parameters))):
            name = parameters.name_at(at)
            if name is not None:
                link.send(parameters.value_message(name, at))
        self._dumps[id(link)] = index + _PARAMETERS_PER_TICK
        if index + _PARAMETERS_PER_TICK >= len(parameters):
            del self._dumps[id(link)]
