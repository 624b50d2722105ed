"""An AR.Drone in memory, on its own virtual time: the pilot's rules fly it through `ArdroneControls`, tick by tick.

It is a tilting point mass with lag and drag, knows AT commands by name, and hovers by itself; no bytes, no sockets.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from mission.vehicle.ardrone.at import AtCommand
from mission.vehicle.ardrone.config import FlightConfig
from mission.vehicle.ardrone.controls import ArdroneControls
from mission.vehicle.ardrone.navdata import DroneState, Navdata
from mission.vehicle.ardrone.navdata_options import Control, Demo, DroneTime, Gps
from mission.vehicle.ardrone.reckoning import Reckoning
from mission.vehicle.ardrone.vehicle import ArdroneVehicle
from mission.vehicle.drone import Bounds, OrderState, Path
from mission.vehicle.limits import FlightSettings
from mission.vehicle.pilot.protocol import EventReport, FlyOrder, OrderKind, OrderReport
from mission.vehicle.pilot.rules import FlightRules

TICK_S = 0.02
LAG_S = 0.18
DRAG_PER_S = 0.35
CONFIG = FlightConfig()


class FakeArdrone:
    """Truth in north, east, up and heading; `control` is the drone's own state."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.control = Control.LANDED
        self.place = np.zeros(3)
        self.velocity = np.zeros(3)
        self.heading = 0.3
        self.tilt_forward = self.tilt_right = 0.0
        self.emergency = False
        self.gps: Gps | None = None
        self.wind = np.zeros(2)
        self.silent = False
        self.program_alive = True
        self.sent: list[tuple[float, AtCommand]] = []
        self.reports: list[OrderReport | EventReport] = []
        self.vehicle = ArdroneVehicle()
        self.controls = ArdroneControls(self.vehicle, CONFIG, lambda: self.now_s)
        self.flight = FlightRules(self.controls, self.vehicle, FlightSettings(), self.reports.append)
        self.reckoning = Reckoning()
        self._sequence = 0
        self._shares: tuple[float, float, float, float] | None = None
        self._until_s = 0.0
        self._ids = 0
        self.run(0.1)

    def airborne(self, height_m: float = 1.5) -> FakeArdrone:
        """Hovering."""
        self.control = Control.HOVERING
        self.place[2] = height_m
        self.run(1.0)
        self.flight.begin(Bounds(), self.now_s)
        return self

    def run(self, seconds: float) -> FakeArdrone:
        """Let time pass."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            if self.program_alive:
                self.flight.heard(self.now_s)
            self._fly()
            if not self.silent:
                navdata = self._navdata()
                self.vehicle.take(navdata, self.reckoning.add(navdata, self.now_s), self.now_s)
            self.flight.step(self.now_s)
            for command in self.controls.commands(self.now_s):
                self.sent.append((self.now_s, command))
                self._obey(command)
        return self

    def order(
        self, kind: OrderKind, height_m: float | None = None, heading_rad: float | None = None, path: Path | None = None
    ) -> int:
        """Hand over an order; its number."""
        self._ids += 1
        order = FlyOrder(id=self._ids, kind=kind, height_m=height_m, heading_rad=heading_rad, path=path)
        self.flight.order(order, self.now_s)
        return self._ids

    def outcome(self, number: int) -> tuple[OrderState, str]:
        """The newest report of an order."""
        found = [r for r in self.reports if isinstance(r, OrderReport) and r.id == number]
        return (found[-1].state, found[-1].reason) if found else (OrderState.PENDING, "")

    def done(self, number: int, within_s: float = 20.0) -> None:
        """Let time pass until an order is done."""
        until = self.now_s + within_s
        while self.outcome(number)[0] in (OrderState.PENDING, OrderState.FLYING) and self.now_s < until:
            self.run(TICK_S)
        assert self.outcome(number)[0] is OrderState.DONE, self.outcome(number)

    def cut_motors(self) -> None:
        """Somebody's emergency."""
        self.emergency = True

    def in_emergency(self) -> bool:
        """Whether the motors are cut."""
        return self.emergency

    def state_name(self) -> str:
        """The drone's own state."""
        return self.control.name

    def events(self, kind: str) -> list[str]:
        """Texts of the events of one kind."""
        return [r.text for r in self.reports if isinstance(r, EventReport) and r.kind == kind]

    def names_since(self, t_s: float) -> set[str]:
        """Names of what was sent after a time; a PCMD that hovers is HOVER."""
        named = set()
        for at, command in self.sent:
            if at > t_s:
                named.add("HOVER" if command.name == "PCMD" and command.arguments[0] == "0" else command.name)
        return named

    def _obey(self, command: AtCommand) -> None:
        if command.name == "REF":
            bits = int(command.arguments[0])
            if bits & 1 << 8:
                self.emergency = not self.emergency
            elif bits & 1 << 9:
                if self.control == Control.LANDED and not self.emergency:
                    self.control, self._until_s = Control.TAKING_OFF, self.now_s + 2.0
            elif self.control not in (Control.LANDED, Control.LANDING):
                self.control = Control.LANDING
        elif command.name == "PCMD":
            flag, *bits_of = (int(a) for a in command.arguments)
            shares = [struct.unpack("<f", struct.pack("<i", b))[0] for b in bits_of]
            self._shares = (shares[0], shares[1], shares[2], shares[3]) if flag & 1 else None

    def _fly(self) -> None:
        dt = TICK_S
        if self.emergency:
            self.control = Control.LANDED
        if self.control == Control.LANDED:
            self.place[2], self.velocity[:] = 0.0, 0.0
            return
        roll, pitch, gaz, yaw = self._shares or (0.0, 0.0, 0.0, 0.0)
        sine, cosine = math.sin(self.heading), math.cos(self.heading)
        if self._shares is None or self.control in (Control.TAKING_OFF, Control.LANDING):
            # The drone's own hover: it brakes over the ground that it sees.
            yaw = gaz = 0.0
            forward = self.velocity[0] * cosine + self.velocity[1] * sine
            right = self.velocity[1] * cosine - self.velocity[0] * sine
            pitch, roll = max(-1.0, min(1.0, forward)), max(-1.0, min(1.0, -right))
        if self.control == Control.TAKING_OFF:
            gaz = 0.4
            if self.now_s > self._until_s:
                self.control = Control.HOVERING
        elif self.control == Control.LANDING:
            gaz = -0.6
            if self.place[2] <= 0.02:
                self.control = Control.LANDED
        else:
            self.control = Control.HOVERING if self._shares is None else Control.FLYING
        blend = dt / LAG_S
        most = CONFIG.euler_angle_max_rad
        self.tilt_forward += blend * (-pitch * most - self.tilt_forward)
        self.tilt_right += blend * (roll * most - self.tilt_right)
        ahead, aside = 9.81 * math.tan(self.tilt_forward), 9.81 * math.tan(self.tilt_right)
        push = np.array([ahead * cosine - aside * sine, ahead * sine + aside * cosine])
        self.velocity[:2] += dt * (push - DRAG_PER_S * (self.velocity[:2] - self.wind))
        self.velocity[2] += dt / 0.3 * (gaz * CONFIG.control_vz_max_m_s - self.velocity[2])
        self.place += dt * self.velocity
        self.place[2] = max(0.0, self.place[2])
        self.heading += dt * yaw * CONFIG.control_yaw_rad_s

    def _navdata(self) -> Navdata:
        self._sequence += 1
        sine, cosine = math.sin(self.heading), math.cos(self.heading)
        north, east, up = (float(v) for v in self.velocity)
        demo = Demo(
            self.control,
            0,
            0.9,
            -self.tilt_forward,
            self.tilt_right,
            self.heading,
            float(self.place[2]),
            (north * cosine + east * sine, east * cosine - north * sine, -up),
        )
        state = int(DroneState.FLYING) if self.control != Control.LANDED else 0
        state |= int(DroneState.EMERGENCY) if self.emergency else 0
        return Navdata(state, self._sequence, demo, DroneTime(self.now_s - 90.0), gps=self.gps)
