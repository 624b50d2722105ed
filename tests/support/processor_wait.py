"""How long a process was ready to run while the machine ran others: what an answer's delay is not to blame for."""

from __future__ import annotations

import time
from pathlib import Path


class Stopwatch:
    """Time since the start, on the wall and of our own."""

    def __init__(self) -> None:
        self._waited = _waited_s()
        self._began_s = time.monotonic()

    @property
    def wall_s(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._began_s

    @property
    def own_s(self) -> float:
        """Those seconds less the ones for which the thread that waited longest for a processor did so.

        The kernel's own count (/proc/PID/task/TID/schedstat, run_delay); where there is none, all of them.
        """
        now = _waited_s()
        waited = max((s - self._waited.get(thread, 0.0) for thread, s in now.items()), default=0.0)
        return max(0.0, self.wall_s - waited)


def _waited_s() -> dict[str, float]:
    found = {}
    for path in Path("/proc/self/task").glob("*/schedstat"):
        try:
            found[path.parent.name] = int(path.read_text().split()[1]) * 1e-9
        except OSError:  # the thread has just ended
            continue
    return found
