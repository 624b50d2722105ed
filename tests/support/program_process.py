"""`tests.support.program` in a process of its own, to be hung and killed."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path as FilePath
from typing import Any

_ROOT = FilePath(__file__).parents[2]


class Program:
    """The running program: orders to it, news from it (one JSON object a line)."""

    def __init__(self, url: str, environment: dict[str, str] | None = None) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.support.program", url],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=_ROOT,
            env={**os.environ, **(environment or {})},
        )
        self._news: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self.past: list[dict[str, Any]] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.pilot_pid = int(self.wait_for("pilot", timeout_s=25.0)["pilot"])

    def tell(self, order: str) -> None:
        """Give it an order."""
        assert self._process.stdin is not None
        self._process.stdin.write(order + "\n")
        self._process.stdin.flush()

    def signal(self, number: signal.Signals) -> float:
        """Send it a signal; when."""
        now = time.monotonic()
        self._process.send_signal(number)
        return now

    def wait_for(self, *keys: str, timeout_s: float = 20.0) -> dict[str, Any]:
        """The next news with one of these keys."""
        deadline = time.monotonic() + timeout_s
        while True:
            try:
                news = self._news.get(timeout=max(0.001, deadline - time.monotonic()))
            except queue.Empty:
                raise AssertionError(f"no {keys} within {timeout_s} s; it said {self.past[-6:]}") from None
            self.past.append(news)
            if any(key in news for key in keys):
                return news

    def said(self, kind: str) -> list[dict[str, Any]]:
        """Events of a kind since the last `forget`."""
        self._drain()
        return [news for news in self.past if news.get("event") == kind]

    def forget(self) -> None:
        """Drop what it has said."""
        self._drain()
        self.past.clear()

    def _drain(self) -> None:
        while not self._news.empty():
            self.past.append(self._news.get())

    def close(self) -> None:
        """End it, whatever state it is in."""
        self._process.send_signal(signal.SIGCONT)
        self._process.kill()
        self._process.wait(5.0)
        self._reader.join(2.0)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None and not pipe.closed:
                try:
                    pipe.close()
                except BrokenPipeError:
                    continue

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._news.put(json.loads(line))
