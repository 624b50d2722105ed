"""The program's end of the pilot process: starts it, keeps it alive, hands it orders and follows them."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import IO

from pydantic import BaseModel

import mission
from mission.errors import LinkError
from mission.vehicle.drone import DroneEvent, OrderState
from mission.vehicle.pilot.protocol import (
    MAX_LINE,
    EventReport,
    Failed,
    FlyOrder,
    KeepAlive,
    OrderReport,
    Quit,
    Ready,
    ToPilot,
    decode_from_pilot,
    encode,
)

_KEEP_ALIVE_S = 0.05
_LOG_BYTES = 4 * 2**20
_ANSWERS_S = 30.0
"""To start, to learn what the autopilot guards and to close its connections again, on a machine that is busy."""
_FINAL = (OrderState.DONE, OrderState.REFUSED, OrderState.ENDED)


class WatchedOrder:
    """`mission.vehicle.drone.Order`, moved on by the pilot process's reports."""

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._state = OrderState.PENDING
        self._reason = ""
        self._started_s: float | None = None
        self._ended_s: float | None = None

    @property
    def kind(self) -> str:
        """take-off, hover, turn, path, hold or land."""
        return self._kind

    @property
    def state(self) -> OrderState:
        """How far it has come."""
        return self._state

    @property
    def reason(self) -> str:
        """Why it was refused or ended."""
        return self._reason

    @property
    def started_s(self) -> float | None:
        """When it began to be flown."""
        return self._started_s

    @property
    def ended_s(self) -> float | None:
        """When it became final."""
        return self._ended_s

    def move_on(self, state: OrderState, reason: str, t_s: float) -> None:
        """Take in a report; a final state stays."""
        if self._state in _FINAL:
            return
        if state is OrderState.FLYING and self._started_s is None:
            self._started_s = t_s
        self._reason = reason
        if state in _FINAL:
            self._ended_s = t_s
        self._state = state


class PilotProcess:
    """A running pilot process.

    Nothing here keeps the vehicle flying by itself: `keep_alive` must be called from the program's own loop. A thread
    that sent it would outlive a loop that hangs.

    Args:
        config: for the process.
        log: file for what the process and MAVSDK write; None drops it.
        clock: monotonic seconds.
        module: what the process runs.
    """

    def __init__(
        self,
        config: BaseModel,
        log: FilePath | None = None,
        clock: Callable[[], float] = time.monotonic,
        module: str = "mission.vehicle.mavlink.pilot",
    ) -> None:
        self._clock = clock
        self._orders: dict[int, WatchedOrder] = {}
        self._events: deque[DroneEvent] = deque(maxlen=500)
        self._lost: DroneEvent | None = None
        self._lock = threading.Lock()
        self._said_s = 0.0
        self._answered = threading.Event()
        self._ready: Ready | None = None
        self._failed: Failed | None = None
        self._closing = False
        self._gone = False
        self._process = _start(module, config, log)
        self._reader = threading.Thread(target=self._read, name="pilot-reports", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def wait_ready(self, timeout_s: float) -> int:
        """Wait until it hears the vehicle; returns the vehicle's system id.

        Args:
            timeout_s: how long the process itself tries. It is waited for longer than that, since only it knows why
                it does not get ready.

        Raises:
            LinkError: it cannot open the connection, hears no autopilot, ended or hangs.
        """
        self._answered.wait(timeout_s + _ANSWERS_S)
        if self._ready is not None:
            return self._ready.system
        if self._failed is not None:
            raise LinkError(self._failed.cause, self._failed.remedy)
        if not self.alive:
            raise LinkError("the pilot process ended before it was ready", "Its log may say why")
        raise LinkError("the pilot process hangs while it connects", "Its log may say why")

    def keep_alive(self) -> None:
        """Tell it that the program's loop is alive; at most every 50 ms, so that it may be called at any rate."""
        if self._clock() - self._said_s >= _KEEP_ALIVE_S:
            self.send(KeepAlive())

    def send(self, line: ToPilot) -> bool:
        """Send a line; False when the process is gone."""
        with self._lock:
            if self._gone:
                return False
            self._said_s = self._clock()
            try:
                _pipe(self._process.stdin).write(encode(line))
                _pipe(self._process.stdin).flush()
            except (OSError, ValueError):
                return False
        return True

    def order(self, order: FlyOrder) -> WatchedOrder:
        """Hand over an order and follow it."""
        watched = WatchedOrder(order.kind)
        with self._lock:
            self._orders[order.id] = watched
        if not self.send(order):
            watched.move_on(OrderState.REFUSED, "the pilot process is gone", self._clock())
        return watched

    def take_events(self) -> list[DroneEvent]:
        """What happened since the last call; that the process is gone is told every time, so that nobody misses it."""
        with self._lock:
            events = list(self._events)
            self._events.clear()
        return events if self._lost is None else [*events, self._lost]

    def close(self, timeout_s: float = 8.0) -> None:
        """Let it give control back and end; killed when it does not. Safe to call twice."""
        self._closing = True
        if self.alive:
            self.send(Quit())
            try:
                self._process.wait(timeout_s)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(5.0)
        self._reader.join(2.0)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                try:
                    pipe.close()
                except BrokenPipeError:
                    continue

    def _read(self) -> None:
        source = _pipe(self._process.stdout)
        while line := source.readline(MAX_LINE):
            self._take(line)
        now = self._clock()
        with self._lock:
            self._gone = True
            orders = list(self._orders.values())
            self._orders.clear()
            if not self._closing and self._ready is not None:
                self._lost = DroneEvent(
                    now, "pilot-process-lost", "the pilot process is gone; the autopilot's failsafe acts"
                )
        for order in orders:
            order.move_on(OrderState.ENDED, "the pilot process is gone", now)
        self._answered.set()

    def _take(self, line: bytes) -> None:
        match decode_from_pilot(line):
            case Ready() as ready:
                self._ready = ready
                self._answered.set()
            case Failed() as failed:
                self._failed = failed
                self._answered.set()
            case EventReport() as event:
                with self._lock:
                    self._events.append(DroneEvent(event.t_s, event.kind, event.text))
            case OrderReport() as report:
                with self._lock:
                    order = self._orders.get(report.id)
                    if report.state in _FINAL:
                        self._orders.pop(report.id, None)
                if order is not None:
                    order.move_on(report.state, report.reason, report.t_s)
            case None:
                return


def _start(module: str, config: BaseModel, log: FilePath | None) -> subprocess.Popen[bytes]:
    # The process finds this package where we did, whatever its working directory.
    root = str(FilePath(mission.__file__).parents[1])
    path = os.pathsep.join(p for p in (root, os.environ.get("PYTHONPATH", "")) if p)
    command = [sys.executable, "-m", module, config.model_dump_json()]
    if log is not None:
        _rotate(log)
    errors: IO[bytes] | int = subprocess.DEVNULL if log is None else log.open("ab")
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            env={**os.environ, "PYTHONPATH": path},
            # Ctrl-C at the terminal must not end it before it has put the vehicle into hold.
            start_new_session=True,
        )
    finally:
        if not isinstance(errors, int):
            errors.close()


def _rotate(log: FilePath) -> None:
    """Put a log aside that has grown large, in the place of the one that was put aside before."""
    with contextlib.suppress(OSError):  # then it grows on
        if log.stat().st_size > _LOG_BYTES:
            log.replace(log.with_name(f"{log.name}.1"))


def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
    if pipe is None:
        raise ValueError("the process was started without pipes")
    return pipe
