"""A thread that writes for others, so that no flight ever waits for a disk."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable

_LOG = logging.getLogger(__name__)
_MOST_WAITING = 4000
_END_S = 5.0

Work = Callable[[], None]


class BackgroundWriter:
    """Does pieces of work in their order; gives up for good when one fails or too many wait.

    Args:
        name: of what is written, for the log.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._queue: queue.Queue[Work | None] = queue.Queue(_MOST_WAITING)
        self.failed = ""
        """Why no more is written; empty while all goes well."""
        self._thread = threading.Thread(target=self._run, name=f"write-{name}", daemon=True)
        self._thread.start()

    def put(self, work: Work) -> None:
        """Have something written, some time; returns at once."""
        if self.failed:
            return
        try:
            self._queue.put_nowait(work)
        except queue.Full:
            self.fail("the disk is too slow")

    def fail(self, why: str) -> None:
        """Write no more."""
        if not self.failed:
            self.failed = why
            _LOG.warning("%s is no longer recorded: %s", self._name, why)

    def close(self, last: Work | None = None) -> None:
        """Write what waits and then `last`; waits for some seconds at most. Safe to call twice."""
        if self._thread.is_alive():
            try:
                if last is not None:
                    self._queue.put(last, timeout=_END_S)
                self._queue.put(None, timeout=_END_S)
            except queue.Full:
                self.fail("the disk does not answer")
                return
            self._thread.join(_END_S)

    def _run(self) -> None:
        while (work := self._queue.get()) is not None:
            if self.failed and not self._queue.empty():
                continue
            try:
                work()
            except OSError as error:  # FFmpeg's errors are such, too
                self.fail(error.strerror or str(error))
            except ValueError as error:
                self.fail(str(error))
