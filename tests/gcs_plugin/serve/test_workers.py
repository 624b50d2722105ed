"""Work in the background: its result, its error, and that it never holds up the program's end."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from gcs_plugin.serve.workers import in_the_background

HANGING = """
import threading, time
from gcs_plugin.serve.workers import in_the_background
began = threading.Event()
def hang():
    began.set()
    time.sleep(60.0)
in_the_background(hang)
began.wait()
"""


def test_the_result_and_the_error_reach_who_asks() -> None:
    assert in_the_background(lambda: 7).result(10.0) == 7
    with pytest.raises(ZeroDivisionError):
        in_the_background(lambda: 1 // 0).result(10.0)


def test_work_that_hangs_does_not_hold_up_the_programs_end() -> None:
    began_s = time.monotonic()
    subprocess.run([sys.executable, "-c", HANGING], check=True, timeout=50.0)
    assert time.monotonic() - began_s < 40.0
