"""A simulated aircraft in a process of its own, seen from the one that started it."""

from __future__ import annotations

import contextlib
import json
import selectors
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence

from mission.errors import LinkError


class AircraftProcess:
    """A running aircraft. It ends with `stop`, and also when this process dies.

    Args:
        name: what it is called in errors: "the simulated ...".
        process: runs `sitl.aircraft.server.run_program` with orders.
        stop_s: how long it may take to end.
    """

    def __init__(self, name: str, process: subprocess.Popen[str], stop_s: float) -> None:
        self._name = name
        self._process = process
        self._stop_s = stop_s

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def state(self, timeout_s: float = 5.0) -> dict[str, object]:
        """The aircraft's inside, for tests: `state_of` of its server's module.

        Raises:
            LinkError: it does not answer.
        """
        return self._asked({"state": True}, timeout_s)

    def stop(self) -> None:
        """End it. Safe to call twice."""
        stdin = self._process.stdin
        if stdin is not None and not stdin.closed:
            with contextlib.suppress(BrokenPipeError):
                stdin.close()
        try:
            self._process.wait(self._stop_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _asked(self, order: Mapping[str, object], timeout_s: float) -> dict[str, object]:
        self._order(order)
        answer = _read_line(self._process, timeout_s)
        if not answer:
            raise LinkError(f"{self._name} does not answer", "see its standard error")
        found: dict[str, object] = json.loads(answer)
        return found

    def _order(self, order: Mapping[str, object]) -> None:
        stdin = self._process.stdin
        if stdin is None or stdin.closed or not self.alive:
            raise LinkError(f"{self._name} has ended", "start it again")
        stdin.write(json.dumps(order) + "\n")
        stdin.flush()


def start_program(
    name: str, module: str, arguments: Sequence[str], start_s: float
) -> tuple[subprocess.Popen[str], str]:
    """Start a program that takes orders, and wait until it has told its ports.

    Args:
        name: what it is called in errors.
        module: whose `main` calls `sitl.aircraft.server.run_program`.
        arguments: for it, besides ``--control``.
        start_s: how long it may take.

    Returns:
        The process, and its ports in JSON.

    Raises:
        LinkError: it did not start.
    """
    # a session of its own: Ctrl-C is for the program that flies it, not for the aircraft
    process = subprocess.Popen(
        [sys.executable, "-m", module, "--control", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    line = _read_line(process, start_s)
    if not line:
        process.kill()
        process.wait()
        raise LinkError(f"{name} did not start", "see its standard error above")
    return process, line


def _read_line(process: subprocess.Popen[str], timeout_s: float) -> str:
    """A line from its standard output; empty if none comes in time."""
    if process.stdout is None:
        return ""
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            if selector.select(0.2):
                return process.stdout.readline()
            if process.poll() is not None:
                return ""
    return ""
