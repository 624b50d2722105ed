"""A simulated AR.Drone in this process, in real time, for clients that know nothing of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from mission.records import Image
from sitl.ardrone.config import ArdroneConfig
from sitl.ardrone.server import ArdroneServer

ANY_PORTS = ArdroneConfig(at_port=0, navdata_port=0, video_port=0, control_port=0)


@contextmanager
def flying(config: ArdroneConfig) -> Iterator[ArdroneServer]:
    """Run an aircraft until the end of the block."""
    server = ArdroneServer(config, None)
    thread = threading.Thread(target=server.run, name="simulated-ardrone", daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(5.0)


def until(what: Callable[[], bool], seconds: float = 10.0) -> bool:
    """Wait for something; whether it came."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if what():
            return True
        time.sleep(0.01)
    return what()


def bar_picture(number: int) -> Image:
    """A picture whose left half is blue, the right one red, with a white bar that moves."""
    picture = np.zeros((360, 640, 3), np.uint8)
    picture[:, :320, 0] = 200
    picture[:, 320:, 2] = 200
    at = 10 * (number % 60)
    picture[100:200, at : at + 8] = 255
    return picture
