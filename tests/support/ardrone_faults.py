"""What befalls the AR.Drone in the air, flown in one go beside the other aircraft's faults."""

from __future__ import annotations

import os
import signal
import socket
import time
from dataclasses import dataclass

from mission.vehicle.drone import Bounds, DroneEvent, Order
from tests.support.flown_aircraft import FINAL, OUT_AND_BACK, ArdroneFlown

LANDS = "AT*REF=1,290717696\r"
"""Sequence 1 is always taken."""
CUTS_THE_MOTORS = "AT*REF=1,290717952\rAT*REF=2,290717696\r"


@dataclass(frozen=True, slots=True)
class Ended:
    """A path that something ended."""

    path: Order
    events: list[DroneEvent]
    at_rest: bool
    """It hovers, or stands on the ground, within a few seconds."""

    def said(self, kind: str) -> str:
        """The texts of one kind of event."""
        return " ".join(event.text for event in self.events if event.kind == kind)


@dataclass(frozen=True, slots=True)
class ArdroneFaults:
    """In the order in which they were flown."""

    pilot_killed: Ended
    on_bad_wifi: Ended
    lost_share: float
    """Of the datagrams on that Wi-Fi, from the connection on."""
    bad_wifi_pose_rate_hz: float
    motors_cut: Ended
    take_off_after_the_cut: Order
    landed_by_another: Ended
    take_off_unasked: Order
    landing: Order
    hover_when_closed: Order


def flown_through_its_faults(craft: ArdroneFlown) -> ArdroneFaults:
    """Fly them all, from the air to the ground."""
    drone, wifi = craft.drone, craft.wifi
    killed = _pilot_killed(craft)

    drone.close()
    craft.spoil(True)
    wifi.relayed = wifi.dropped = 0
    drone.connect(20.0)
    craft.until(lambda: drone.telemetry().position_ok, 20.0)
    craft.hovers()
    path = drone.fly(OUT_AND_BACK)
    events = craft.until(lambda: path.state in FINAL, 20.0)
    craft.final(drone.hold())
    on_bad_wifi = Ended(path, events, craft.comes_to_rest())
    lost, rate_hz = wifi.dropped / wifi.relayed, drone.telemetry().pose_rate_hz
    craft.spoil(False)

    cut = _another_sends(craft, CUTS_THE_MOTORS)
    drone.begin(Bounds(min_height_m=0.8))
    again = craft.final(drone.take_off(1.2))
    landed = _another_sends(craft, LANDS)
    unasked = craft.final(drone.take_off(1.2))
    drone.begin(Bounds(min_height_m=0.8))
    craft.final(drone.take_off(1.2))
    landing = craft.final(drone.land())
    drone.close()
    drone.close()
    return ArdroneFaults(
        killed, on_bad_wifi, lost, rate_hz, cut, again, landed, unasked, landing, hover_when_closed=drone.hover()
    )


def _pilot_killed(craft: ArdroneFlown) -> Ended:
    path = craft.on_its_way()
    assert craft.drone.pilot_pid is not None
    os.kill(craft.drone.pilot_pid, signal.SIGKILL)
    events = craft.until(lambda: path.state in FINAL, 5.0)
    return Ended(path, events + craft.wait(0.2), craft.comes_to_rest())


def _another_sends(craft: ArdroneFlown, commands: str) -> Ended:
    """Another client's AT commands, in the middle of a path; waits until it is on the ground."""
    path = craft.on_its_way()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(commands.encode(), ("127.0.0.1", craft.simulated.ports.at))
    events = craft.until(lambda: path.state in FINAL, 10.0)
    events += craft.until(lambda: not craft.drone.telemetry().in_air, 25.0)
    deadline = time.monotonic() + 5.0
    while craft.speed_m_s() > 0.3 and time.monotonic() < deadline:
        craft.wait(0.05)
    return Ended(path, events, craft.speed_m_s() <= 0.3)
