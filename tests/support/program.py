"""A program that flies patterns with `MavlinkDrone`, to be hung, killed and silenced: ``python -m ... URL``.

Orders come on the standard input, one a line; what happens goes to the standard output as JSON, one object a line. The
drone hears of this program only from the loop below, as it would from any program's own loop.
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
import time

from mission.vehicle.drone import Bounds, Knot, Order, OrderState, Path
from mission.vehicle.mavlink.mavlink_drone import MavlinkDrone

TURN_S = 0.02


def path(metres: float, climb_m: float = 0.0, seconds: float = 6.0) -> Path:
    """Out and back, eastwards (westwards when negative), climbing on the way."""
    half, speed = seconds / 2.0, 1.5 * metres / (seconds / 2.0)
    return Path(
        (
            Knot(0.0, (0, 0, 0), (0, 0, 0)),
            Knot(half / 2.0, (metres / 2.0, 0, climb_m / 2.0), (speed, 0, 0)),
            Knot(half, (metres, 0, climb_m), (0, 0, 0)),
            Knot(1.5 * half, (metres / 2.0, 0, climb_m), (-speed, 0, 0)),
            Knot(seconds, (0, 0, climb_m), (0, 0, 0)),
        )
    )


class Program:
    """The loop: orders in, the drone kept alive, news out."""

    def __init__(self, drone: MavlinkDrone) -> None:
        self._drone = drone
        self._pending = b""
        self._order: Order | None = None
        self._then: Path | None = None
        self._climb_m: float | None = None
        os.set_blocking(0, False)

    def run(self) -> None:
        """Until told to quit."""
        while True:
            for line in self._lines():
                word, *values = line.split()
                if word == "quit":
                    return
                self._do(word, [float(value) for value in values])
            for event in self._drone.events():
                say(event=event.kind, text=event.text, t_s=event.t_s)
            self._follow()
            time.sleep(TURN_S)  # paces the loop

    def _do(self, word: str, values: list[float]) -> None:
        if word == "take-off":
            self._climb_m = values[0]
        elif word == "fly":
            self._drone.begin(Bounds())
            self._order, self._then = self._drone.hover(), path(*values)
        elif word == "hover":
            self._order, self._then = self._drone.hover(), None
        elif word == "hold":
            self._order, self._then = self._drone.hold(), None
        elif word == "state":
            say(connected=self._drone.telemetry().connected, mode=self._drone.telemetry().mode)
        elif word == "silent":
            say(broken_s=time.monotonic())
            time.sleep(values[0])
        elif word == "block":
            say(broken_s=time.monotonic())
            hold_the_interpreter(values[0])

    def _follow(self) -> None:
        if self._climb_m is not None and self._drone.telemetry().position_ok:
            self._drone.begin(Bounds())
            self._order, self._climb_m = self._drone.take_off(self._climb_m), None
        order = self._order
        if order is None:
            return
        if order.kind == "path" and order.started_s is not None and self._then is not None:
            say(flying_s=order.started_s)
            self._then = None
        if order.state in (OrderState.PENDING, OrderState.FLYING):
            return
        self._order = None
        if order.kind == "hover" and order.state is OrderState.DONE and self._then is not None:
            self._order = self._drone.fly(self._then)
        else:
            say(order=order.kind, state=order.state.value, reason=order.reason)

    def _lines(self) -> list[str]:
        try:
            data = os.read(0, 4096)
        except BlockingIOError:
            return []
        if not data:
            return ["quit"]
        *lines, self._pending = (self._pending + data).split(b"\n")
        return [line.decode() for line in lines]


def hold_the_interpreter(seconds: float) -> None:
    """No thread of this process runs Python meanwhile: a foreign call that keeps the interpreter's lock."""
    ctypes.PyDLL(None).usleep(int(seconds * 1e6))


def say(**news: object) -> None:
    """One line of JSON."""
    sys.stdout.write(json.dumps(news) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Connect, tell the pilot process's id, run."""
    drone = MavlinkDrone(sys.argv[1])
    drone.connect(20.0)
    say(pilot=drone.pilot_pid)
    Program(drone).run()
    drone.close()


if __name__ == "__main__":
    main()
