"""Python imports this at its start when this folder is on PYTHONPATH: signals then hang a process from inside.

SIGUSR1 hangs the main thread and lets the others run; SIGUSR2 hangs Python as a whole.
"""

from __future__ import annotations

import ctypes
import signal
import time

_HANG_S = 20


def _hang_main_thread(number: int, frame: object) -> None:
    time.sleep(_HANG_S)


def _hang_python(number: int, frame: object) -> None:
    ctypes.PyDLL(None).sleep(_HANG_S)  # keeps the interpreter's lock


signal.signal(signal.SIGUSR1, _hang_main_thread)
signal.signal(signal.SIGUSR2, _hang_python)
