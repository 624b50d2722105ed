"""Faults in flight, measured on the wire next to the aircraft: a relay with a wiretap, and a program to break."""

from __future__ import annotations

import math
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from sitl.aircraft.truth import TruthRing, VehicleTruth
from sitl.autopilot import AutopilotConfig, AutopilotProcess, start_autopilot
from sitl.autopilot.config import FlavourName
from sitl.autopilot.local_frame import LocalFrame
from sitl.faults import FaultRelay, LinkFaults, Wiretap
from tests.support.program_process import Program

Fault = Literal["hung", "killed", "silent", "blocked"]
HOLD: dict[FlavourName, tuple[tuple[int, int], ...]] = {"px4": ((4, 3),), "ardupilot": ((17, 0), (5, 0))}
"""Main and sub mode of what holds still by itself, as DO_SET_MODE orders it."""
OFFBOARD: dict[FlavourName, tuple[int, int]] = {"px4": (6, 0), "ardupilot": (4, 0)}
HOLDS = ("hold", "brake")
STILL_M_S = 0.3
_CLIMB_M = 2.5
NOT_YET = ("is not heard", "not known yet", "is not healthy", "the link loses", "the vehicle is holding")
"""Reasons of a refusal that pass: what must be known is still on its way, or what was lost is still remembered."""
_SETTLES_S = 10.0


@dataclass(frozen=True, slots=True)
class Reaction:
    """What the aircraft received around a fault; seconds from the fault."""

    last_setpoint_s: float
    hold_ordered_s: float
    """Infinite when it never was."""


class FaultBench:
    """One aircraft behind a relay; programs that fly it come and go."""

    def __init__(
        self,
        autopilot: AutopilotProcess,
        relay: FaultRelay,
        tap: Wiretap,
        ring: TruthRing,
        height_m: float,
    ) -> None:
        self.flavour, self.autopilot, self.relay, self.tap, self.ring = (
            autopilot.config.flavour,
            autopilot,
            relay,
            tap,
            ring,
        )
        self.url = f"udpin://127.0.0.1:{relay.program_port}"
        self.height_m = height_m
        self._program: Program | None = None
        self._operator: Any = None
        self._side = 1.8

    @property
    def program(self) -> Program:
        """The program that is connected; a new one when the last was broken."""
        if self._program is None:
            # The folder lets signals hang the pilot process from inside.
            self._program = Program(self.url, {"PYTHONPATH": str(Path(__file__).parent / "hang")})
        return self._program

    def drop_program(self) -> None:
        """End the program; the next use starts another."""
        if self._program is not None:
            self._program.close()
            self._program = None

    def take_off(self) -> None:
        """From the ground, by the program."""
        self.program.tell(f"take-off {self.height_m}")
        news = self.program.wait_for("order", timeout_s=40.0)
        assert news["state"] == "done", news

    def fly(self, into_s: float) -> None:
        """Fly a pattern, out east and then west in turns; return so many seconds into it."""
        self.program.forget()
        self.tap.clear()
        # The operator's modes may have taken it up or down: back to the height, by a few metres in each flight.
        climb = max(-_CLIMB_M, min(_CLIMB_M, self.height_m - float(self.truth().position_enu_m[2])))
        deadline = time.monotonic() + _SETTLES_S
        while True:
            self.program.tell(f"fly {self._side} {climb if abs(climb) > 0.3 else 0.0}")
            news = self.program.wait_for("flying_s", "order")
            # A program that has just connected may not have heard all yet; one that has flown remembers what was lost.
            if not any(reason in str(news.get("reason")) for reason in NOT_YET) or time.monotonic() > deadline:
                break
            time.sleep(0.1)  # asks again ten times a second
        self._side = -self._side
        assert "flying_s" in news, f"the pattern was not flown: {news}"
        time.sleep(max(0.0, news["flying_s"] + into_s - time.monotonic()))

    def break_program(self, fault: Fault) -> float:
        """Hang, kill, silence or block the program; when."""
        if fault == "hung":
            return self.program.signal(signal.SIGSTOP)
        if fault == "killed":
            return self.program.signal(signal.SIGKILL)
        self.program.tell("silent 1.5" if fault == "silent" else "block 1.5")
        return float(self.program.wait_for("broken_s")["broken_s"])

    def mend_program(self, fault: Fault) -> None:
        """Let it go on, or forget it when it is dead."""
        if fault == "killed":
            self.drop_program()
            return
        if fault == "hung":
            self.program.signal(signal.SIGCONT)
        self.program.wait_for("order")

    def reaction(self, fault_s: float) -> Reaction:
        """What the aircraft received since a fault; call it when it holds."""
        hold = HOLD[self.flavour]
        ordered = [t for t, *mode in self.tap.mode_orders(fault_s) if tuple(mode) in hold]
        setpoints = self.tap.setpoints_s(fault_s)
        return Reaction(
            (setpoints[-1] if setpoints else fault_s) - fault_s, ordered[0] - fault_s if ordered else math.inf
        )

    def operator(self) -> Any:
        """The operator's ground station: pymavlink on a link of its own."""
        if self._operator is None:
            url = self.autopilot.operator_url.replace("://", ":")
            self._operator = mavutil.mavlink_connection(url, source_system=255, source_component=190)
            self._operator.mav.heartbeat_send(6, 8, 0, 0, 4)
            assert self._operator.wait_heartbeat(timeout=3.0) is not None
        return self._operator

    def program_broken(self, fault: Fault, into_s: float) -> Reaction:
        """Break the program so far into a pattern, and wait until the aircraft hovers.

        Raises:
            AssertionError: it does not end in hold and at rest, or is flown again afterwards.
        """
        self.fly(into_s)
        broken_s = self.break_program(fault)
        assert self.until(lambda: self.mode() in HOLDS, 3.0), f"still {self.mode()}"
        reaction = self.reaction(broken_s)
        self.mend_program(fault)
        assert self.comes_to_rest()
        last_s = broken_s + reaction.hold_ordered_s + 0.1
        assert self.tap.setpoints_s(last_s) == [], "setpoints after the hold"
        assert self.mode() in HOLDS
        return reaction

    def pilot_killed(self, into_s: float) -> float:
        """Kill the pilot process in a pattern; seconds until the aircraft hovers by the autopilot's own failsafe."""
        self.fly(into_s)
        killed_s = time.monotonic()
        os.kill(self.program.pilot_pid, signal.SIGKILL)
        assert self.comes_to_rest(10.0), f"it does not hold, in {self.mode()}"
        assert not [t for t in self.tap.setpoints_s(killed_s) if t - killed_s > 0.05]
        assert self.mode() in (*HOLDS, "offboard" if self.flavour == "ardupilot" else "hold")
        return time.monotonic() - killed_s - 1.0

    def pilot_hung(self, into_s: float, number: signal.Signals) -> Reaction:
        """Hang the pilot process's loop (SIGUSR1) or all its Python (SIGUSR2) in a pattern; wait until it hovers."""
        self.fly(into_s)
        hung_s = time.monotonic()
        os.kill(self.program.pilot_pid, number)
        assert self.comes_to_rest(12.0), f"it does not hold, in {self.mode()}"
        # Its alarm ends it after 2 s; an aircraft that has hardly set out rests sooner than that.
        assert self.until(lambda: bool(self.program.said("pilot-process-lost")), 4.0), "the hung process lives on"
        return self.reaction(hung_s)

    def end_failsafe(self) -> None:
        """The operator takes the aircraft out of its failsafe, into a mode that holds; a new program flies next.

        Raises:
            AssertionError: the autopilot stays in its failsafe.
        """
        self.operator_orders_mode(*HOLD[self.flavour][-1])
        self.drop_program()
        assert self.until(lambda: not self.autopilot.state()["failsafe"], 2.0), "it stays in its failsafe"

    def link_cut(self, into_s: float) -> float:
        """Cut the link in a pattern; seconds until the aircraft hovers by the autopilot's own failsafe."""
        self.fly(into_s)
        self.relay.set(LinkFaults(cut=True))
        cut_s = time.monotonic()
        rested = self.comes_to_rest(10.0)
        rested_s = time.monotonic() - cut_s - 1.0
        said = self.program.said("link-lost")
        self.relay.set(LinkFaults())
        assert rested, f"it does not hold, in {self.mode()}"
        assert said, "the program was not told"
        assert said[0]["t_s"] - cut_s < 1.5
        return rested_s

    def taken_over(self, how: Callable[[], float], into_s: float, watch_s: float = 1.5) -> float:
        """The operator takes the aircraft in a pattern; seconds until the last setpoint.

        Raises:
            AssertionError: the pilot process orders a mode after that, or flies again without a new order.
        """
        self.fly(into_s)
        taken_s = how()
        self.until(lambda: bool(self.program.said("pilot")), watch_s)
        self.program.tell("hover")
        news = self.program.wait_for("order")
        if news["order"] == "path":
            news = self.program.wait_for("order")
        assert (news["order"], news["state"]) == ("hover", "refused"), "flown again without a new order"
        time.sleep(max(0.0, taken_s + watch_s - time.monotonic()))
        setpoints = self.tap.setpoints_s(taken_s)
        assert self.tap.mode_orders(taken_s) == [], "a mode was ordered after the take-over"
        return (setpoints[-1] if setpoints else taken_s) - taken_s

    def operator_orders_mode(self, main: int, sub: int) -> float:
        """The operator changes the mode; when."""
        now = time.monotonic()
        self.operator().mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, main, sub, 0, 0, 0, 0)
        return now

    def operator_sends_here(self, north_m: float) -> float:
        """The operator clicks "fly here", so far north of the aircraft; when."""
        home = self.autopilot.config.home
        place = self.truth().position_enu_m
        lat, lon, _ = LocalFrame(home.lat_deg, home.lon_deg, 0.0, 0.0).geodetic(
            (float(place[0]), float(place[1]) + north_m, 0.0)
        )
        where = (round(lat * 1e7), round(lon * 1e7), self.height_m)
        now = time.monotonic()
        self.operator().mav.command_int_send(1, 1, 6, mavlink.MAV_CMD_DO_REPOSITION, 0, 0, -1, 0, 0, 0, *where)
        return now

    def truth(self) -> VehicleTruth:
        """Where the aircraft really is."""
        newest = self.ring.newest()
        assert newest is not None
        return newest

    def speed_m_s(self) -> float:
        """True speed."""
        return float(np.linalg.norm(self.truth().velocity_enu_m_s))

    def mode(self) -> str:
        """What the autopilot's inside says."""
        return str(self.autopilot.state()["mode"])

    def comes_to_rest(self, timeout_s: float = 8.0) -> bool:
        """Whether it hovers: true speed below 0.3 m/s for a second, in the air."""
        still_s: float | None = None
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            now = time.monotonic()
            if self.speed_m_s() > STILL_M_S or self.truth().position_enu_m[2] < 0.5:
                still_s = None
            elif still_s is None:
                still_s = now
            elif now - still_s > 1.0:
                return True
            time.sleep(0.05)  # looks at the truth 20 times a second
        return False

    def until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Whether it becomes so in time."""
        deadline = time.monotonic() + timeout_s
        while not done():
            if time.monotonic() > deadline:
                return False
            time.sleep(0.02)  # looks again until the deadline
        return True

    def close(self) -> None:
        """End what was started."""
        self.drop_program()
        if self._operator is not None:
            self._operator.close()


@contextmanager
def fault_bench(
    flavour: FlavourName,
    *,
    seed: int = 7,
    height_m: float = 2.0,
    parameters: tuple[tuple[str, float], ...] | None = None,
) -> Iterator[FaultBench]:
    """An aircraft on the ground, for `take_off`.

    Args:
        flavour: of the autopilot.
        seed: of the aircraft and of the relay.
        height_m: to which it takes off.
        parameters: of the autopilot; None makes PX4 hold when the setpoints stop (its default is to land).
    """
    if parameters is None:
        parameters = (("COM_OBL_RC_ACT", 5.0),) if flavour == "px4" else ()
    with ExitStack() as stack:
        ring = TruthRing.create(seconds=60, rate_hz=200)
        stack.callback(ring.unlink)
        stack.callback(ring.close)
        tap = Wiretap()
        relay = FaultRelay(free_port(), seed=seed, tap=tap)
        stack.callback(relay.close)
        config = AutopilotConfig(
            flavour=flavour,
            seed=seed,
            ready_after_s=1.0,
            parameters=parameters,
            remote_port=relay.vehicle_port,
            battery_endurance_s=7200.0,
        )
        autopilot = start_autopilot(config, ring.name)
        stack.callback(autopilot.stop)
        bench = FaultBench(autopilot, relay, tap, ring, height_m)
        stack.callback(bench.close)
        yield bench


def free_port() -> int:
    """A free UDP port of the loopback interface."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
