"""The camera process: real time, marks, faults, and an end of its own when its parent dies."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import av
import numpy as np
import pytest

from mission.errors import VideoError
from sitl.aircraft.truth import TruthRing, VehicleTruth
from sitl.camera import CameraProcess, start_camera
from sitl.camera.airframe import flies_sideways, level_world_from_body_wxyz
from sitl.scenario.schema import parse_scenario

pytestmark = pytest.mark.flight
"""A camera in real time wants the machine for itself."""

SCENARIO = parse_scenario(
    """
name = "a"
scenery = false
[camera]
width_px = 320
height_px = 240
[[people]]
distance_m = 5.0
bearing_deg = 0.0
speed_m_s = 0.6
when = "drone-moves"
"""
)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def truth(
    t_s: float, velocity: tuple[float, float, float], height_m: float = 1.6, heading: float = 0.0
) -> VehicleTruth:
    return VehicleTruth(t_s, np.array([0.0, 0.0, height_m]), np.array(velocity), level_world_from_body_wxyz(heading))


@dataclass
class Flight:
    """Somebody who writes the truth and somebody who watches the video."""

    ring: TruthRing
    port: int
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seen: list[tuple[float, float, float]] = field(default_factory=list)
    """Arrival, presentation time, grey sum of each frame."""
    over: threading.Event = field(default_factory=threading.Event)

    def write(self) -> None:
        while not self.over.wait(0.005):
            self.ring.write(truth(time.monotonic(), self.velocity))

    def watch(self) -> None:
        options = {"fflags": "nobuffer", "analyzeduration": "200000", "probesize": "100000"}
        with av.open(f"udp://127.0.0.1:{self.port}?timeout=20000000", options=options) as container:
            for frame in container.decode(video=0):
                assert frame.time is not None
                self.seen.append((time.monotonic(), frame.time, float(frame.to_ndarray(format="gray").sum())))
                if self.over.is_set():
                    return

    def wait_for(self, count: int, timeout_s: float = 20.0) -> None:
        deadline = time.monotonic() + timeout_s
        while len(self.seen) < count:
            assert time.monotonic() < deadline, f"only {len(self.seen)} of {count} frames came"
            time.sleep(0.02)


@pytest.fixture(scope="module")
def flight() -> Iterator[tuple[Flight, CameraProcess]]:
    ring = TruthRing.create(seconds=30.0, rate_hz=200.0)
    flight = Flight(ring, free_port())
    writer = threading.Thread(target=flight.write)
    writer.start()
    threading.Thread(target=flight.watch, daemon=True).start()
    camera = start_camera(SCENARIO, ring.name, f"udp://127.0.0.1:{flight.port}")
    yield flight, camera
    camera.stop()
    flight.over.set()
    writer.join()
    ring.close()
    ring.unlink()


def test_frames_come_at_the_camera_s_rate(flight: tuple[Flight, CameraProcess]) -> None:
    watched, camera = flight
    watched.wait_for(30)
    times = np.array([shown for _, shown, _ in watched.seen])
    steps = np.diff(times) / 0.05
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert np.median(steps) == pytest.approx(1.0)
    stats = camera.stats()
    assert stats.frames >= 30
    assert stats.delay_s < 0.5


def test_presentation_time_is_time_since_mark_1(flight: tuple[Flight, CameraProcess]) -> None:
    watched, _ = flight
    watched.wait_for(20)
    start_s = watched.ring.mark(1)
    assert start_s is not None
    delays = [arrived - start_s - shown for arrived, shown, _ in list(watched.seen)]
    assert min(delays) > 0.0
    assert min(delays) < 0.6


def test_the_walk_is_marked_when_the_drone_flies_sideways(flight: tuple[Flight, CameraProcess]) -> None:
    watched, _ = flight
    watched.wait_for(5)
    assert watched.ring.mark(0) is None
    before_s = time.monotonic()
    watched.velocity = (-0.9, 0.0, 0.0)
    watched.wait_for(len(watched.seen) + 15)
    begun_s = watched.ring.mark(0)
    assert begun_s is not None
    assert before_s < begun_s < before_s + 2.0


def test_a_frozen_picture_repeats_until_it_resumes(flight: tuple[Flight, CameraProcess]) -> None:
    watched, camera = flight

    def spread(count: int) -> float:
        watched.wait_for(len(watched.seen) + count)
        return float(np.ptp([grey for _, _, grey in watched.seen[-8:]]))

    moving = spread(10)
    camera.fault("freeze")
    frozen = spread(30)
    camera.fault("resume")
    again = spread(20)
    assert frozen < 0.5 * min(moving, again)


def test_a_cut_link_shows_nothing_until_it_resumes(flight: tuple[Flight, CameraProcess]) -> None:
    watched, camera = flight
    camera.fault("cut")
    time.sleep(0.7)
    count = len(watched.seen)
    time.sleep(0.7)
    assert len(watched.seen) <= count + 1
    camera.fault("resume")
    watched.wait_for(count + 20)


def test_a_camera_without_truth_does_not_start() -> None:
    with pytest.raises(VideoError, match="cannot start"):
        start_camera(SCENARIO, "no-such-ring", f"udp://127.0.0.1:{free_port()}")


ORPHAN = """
import os, sys
from sitl.camera import start_camera
from sitl.scenario.schema import parse_scenario
if __name__ == "__main__":
    print(start_camera(parse_scenario('name = "a"\\nscenery = false'), sys.argv[1], sys.argv[2]).pid, flush=True)
    os._exit(1)
"""


def test_the_camera_ends_when_its_parent_dies(tmp_path: Path) -> None:
    script = tmp_path / "orphan.py"
    script.write_text(ORPHAN)
    ring = TruthRing.create(seconds=1.0)
    try:
        command = [sys.executable, str(script), ring.name, f"udp://127.0.0.1:{free_port()}"]
        # Not capture_output with communicate(): the camera would keep the pipe open, and hide that it lives.
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
            assert parent.stdout is not None
            pid = int(parent.stdout.readline())
            parent.wait(30.0)
            deadline = time.monotonic() + 10.0
            while running(pid):
                assert time.monotonic() < deadline, "the camera outlived its parent"
                time.sleep(0.05)
    finally:
        ring.close()
        ring.unlink()


def running(pid: int) -> bool:
    """Whether a process runs (one that is dead and not yet reaped does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize(
    ("velocity", "height_m", "sideways"),
    [
        ((-0.6, 0.0, 0.0), 1.6, True),
        ((0.6, 0.0, 0.0), 1.6, True),
        ((-0.6, 0.0, 0.0), 0.5, False),
        ((-0.4, 0.0, 0.0), 1.6, False),
        ((0.0, 3.0, 0.0), 1.6, False),
        ((0.0, 0.0, 2.0), 1.6, False),
    ],
)
def test_sideways_is_left_or_right_in_the_air(
    velocity: tuple[float, float, float], height_m: float, sideways: bool
) -> None:
    assert flies_sideways(truth(0.0, velocity, height_m)) is sideways
