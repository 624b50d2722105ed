"""Threads for what would make the service's loop wait; none of them keeps the program from ending."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

Result = TypeVar("Result")


def in_the_background(work: Callable[[], Result]) -> Future[Result]:
    """Do something in a thread of its own. The interpreter does not wait for it at its end (an executor's it joins)."""
    future: Future[Result] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # noqa: BLE001  # the one who asks for the result gets it
            future.set_exception(error)

    threading.Thread(target=run, name="sidestep-serve", daemon=True).start()
    return future
