"""The pilot process's side of the pipe to the program, and the watchdog of its own loop, for any aircraft's pilot."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator

from mission.vehicle.pilot.protocol import MAX_LINE, FromPilot, Quit, ToPilot, decode_to_pilot, encode

_HANG_S = 0.5
_ALARM_S = 2.0
_LOOK_S = 0.1


class PilotPipe:
    """The program's lines as they come, and lines to it; neither side ever blocks the loop."""

    def __init__(self, source: int, sink: int) -> None:
        self.closed = threading.Event()
        self._quit = threading.Event()
        self._lines: queue.SimpleQueue[ToPilot] = queue.SimpleQueue()
        self._out: queue.Queue[FromPilot] = queue.Queue(1000)
        self._source, self._sink = source, sink
        self._parent = os.getppid()
        threading.Thread(target=self._read, name="orders", daemon=True).start()
        self._writer = threading.Thread(target=self._write, name="reports", daemon=True)
        self._writer.start()

    @property
    def abandoned(self) -> bool:
        """Whether the program is gone, or wants this process to end."""
        if os.getppid() != self._parent:
            self.closed.set()
        return self.closed.is_set() or self._quit.is_set()

    @contextlib.contextmanager
    def ends_with_program(self) -> Iterator[None]:
        """While nothing is flown yet: end this process at once when the program is gone, whatever it waits for."""
        over = threading.Event()

        def watch() -> None:
            while not over.wait(_LOOK_S):
                if self.abandoned:
                    os._exit(0)

        threading.Thread(target=watch, name="program", daemon=True).start()
        try:
            yield
        finally:
            over.set()

    def take(self) -> list[ToPilot]:
        """The lines since the last call."""
        if os.getppid() != self._parent:
            self.closed.set()
        lines = []
        with contextlib.suppress(queue.Empty):
            while True:
                lines.append(self._lines.get_nowait())
        return lines

    def send(self, line: FromPilot) -> None:
        """Send a line; dropped when the program has not read a thousand of them."""
        with contextlib.suppress(queue.Full):
            self._out.put_nowait(line)

    def flush(self, timeout_s: float) -> None:
        """Wait until everything is written."""
        until = time.monotonic() + timeout_s
        while self._out.unfinished_tasks and time.monotonic() < until:
            time.sleep(0.01)  # looks again until the deadline

    def _read(self) -> None:
        pending = b""
        while data := os.read(self._source, 65536):
            *lines, pending = (pending + data).split(b"\n")
            for line in lines:
                order = decode_to_pilot(line)
                if isinstance(order, Quit):
                    self._quit.set()
                if order is not None:
                    self._lines.put(order)
            pending = pending[:MAX_LINE]
        self.closed.set()

    def _write(self) -> None:
        while True:
            line = self._out.get()
            try:
                _write_all(self._sink, encode(line))
            except OSError:
                self.closed.set()
            self._out.task_done()


class LoopWatchdog:
    """Ends this process when its loop hangs.

    Args:
        stop: orders the vehicle to hold; called in a thread of its own just before the end.
    """

    def __init__(self, stop: Callable[[], None]) -> None:
        self._order_stop = stop
        self._ticked_s = time.monotonic()
        self._stopped = threading.Event()
        threading.Thread(target=self._watch, name="watchdog", daemon=True).start()

    def tick(self) -> None:
        """The loop is alive."""
        self._ticked_s = time.monotonic()
        # The default action of SIGALRM ends the process without any help from Python.
        signal.setitimer(signal.ITIMER_REAL, _ALARM_S)

    def stop(self) -> None:
        """No more watching, only the alarm for what is left to do."""
        self._stopped.set()
        signal.setitimer(signal.ITIMER_REAL, 5.0)

    def _watch(self) -> None:
        while not self._stopped.wait(0.1):
            if time.monotonic() - self._ticked_s > _HANG_S:
                self._order_stop()
                time.sleep(0.2)  # lets the stop go out before the process ends
                os._exit(3)


def own_stdout() -> tuple[int, int]:
    """File descriptors from and to the program. What a library writes to 1 (MAVSDK: its log) goes to standard error."""
    sink = os.dup(1)
    os.dup2(2, 1)
    return 0, sink


def _write_all(sink: int, data: bytes) -> None:
    while data:
        data = data[os.write(sink, data) :]
