"""A real `mavproxy.py` process without a screen, driven through its standard input."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import sysconfig
import threading
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]


def environment() -> dict[str, str]:
    """For programs that import the tests."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


class MavProxy:
    """Connected to a vehicle. Its output is kept; `expect` reads on from where the last one ended."""

    def __init__(self, vehicle_url: str, folder: Path, *more: str) -> None:
        self.folder = folder
        script = Path(sysconfig.get_path("scripts")) / "mavproxy.py"
        options = ["--master", vehicle_url.replace("://", ":"), "--no-state", "--streamrate", "-1", *more]
        self.process = subprocess.Popen(
            [sys.executable, "-u", str(script), *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
            env={**environment(), "HOME": str(folder)},  # so that nobody's start-up script is run
        )
        self._text = ""
        self._at = 0
        self._grown = threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def type(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def expect(self, pattern: str, timeout_s: float = 30.0) -> re.Match[str]:
        """Wait until the output has it, after what was expected before."""
        expression = re.compile(pattern)
        until = time.monotonic() + timeout_s
        with self._grown:
            while (found := expression.search(self._text, self._at)) is None:
                remaining = until - time.monotonic()
                if remaining <= 0.0 or not self._grown.wait(remaining):
                    raise AssertionError(f"{pattern!r} did not come; since then:\n{self._text[self._at :]}")
            self._at = found.end()
            return found

    def answer(self, line: str, pattern: str, timeout_s: float = 30.0) -> re.Match[str]:
        """Type a line and wait for its answer."""
        self.type(line)
        return self.expect(pattern, timeout_s)

    def retry(self, line: str, pattern: str, timeout_s: float = 30.0) -> re.Match[str]:
        """Type a line again until its answer has it: for states that come by and by."""
        until = time.monotonic() + timeout_s
        while True:
            self.type(line)
            try:
                return self.expect(pattern, 0.3)
            except AssertionError:
                if time.monotonic() > until:
                    raise

    @property
    def text(self) -> str:
        """All that it has written."""
        return self._text

    def threads(self) -> int:
        return len(list(Path(f"/proc/{self.process.pid}/task").iterdir()))

    def files(self) -> set[str]:
        """Its open files and sockets, but for the database that PROJ opens once and keeps."""
        found = {os.readlink(link) for link in Path(f"/proc/{self.process.pid}/fd").iterdir()}
        return {name for name in found if not name.endswith("/proj.db")}

    def children(self) -> set[int]:
        """Processes whose parent it is."""
        found = set()
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):  # it has just ended
                if int(stat.read_text().rpartition(")")[2].split()[1]) == self.process.pid:
                    found.add(int(stat.parent.name))
        return found

    def close(self) -> None:
        assert self.process.stdin is not None
        if not self.process.stdin.closed:
            self.process.stdin.close()
        try:
            self.process.wait(20.0)
        finally:
            self.process.kill()
            self.process.wait()
            self._reader.join()

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as output:
            for line in output:
                with self._grown:
                    self._text += line
                    self._grown.notify_all()
