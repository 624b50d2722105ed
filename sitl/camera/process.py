"""The camera as a process of its own: reads where the aircraft truly is, renders, encodes and sends, in real time.

It keeps to its frame rate: when the machine is slow it drops frames, and counts them, rather than drift.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import Literal

import cv2

from mission.errors import VideoError
from mission.records import Image
from sitl.aircraft.truth import TruthRing, VehicleTruth
from sitl.camera.airframe import TURN_S, CameraOnAirframe, flies_sideways, turns
from sitl.camera.exposure_pipeline import ExposurePipeline, PictureSender
from sitl.camera.renderer import Renderer
from sitl.camera.stream import VideoSender
from sitl.scenario.schema import Scenario

WALK_MARK = 0
"""Mark of the truth at which people began to walk: when the drone flew sideways, or the camera's start."""
CAMERA_MARK = 1
"""Mark of the truth at which the camera started; presentation time zero."""

Fault = Literal["freeze", "cut", "resume"]
_Order = Fault | Literal["stats", "stop"]
_TRUTH_PATIENCE_S = 0.1
_START_PATIENCE_S = 60.0
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class CameraStats:
    """How the camera is doing."""

    frames: int
    dropped: int
    """Frames that were due and not taken, because the machine was too slow."""
    cpu_share: float
    """Of one core, since the first frame."""
    delay_s: float
    """Mean time from capture to the end of encoding (without the extra latency)."""


SenderMaker = Callable[[Scenario, TruthRing], PictureSender]


class CameraProcess:
    """A running camera."""

    def __init__(self, process: multiprocessing.process.BaseProcess, pipe: Connection) -> None:
        self._process = process
        self._pipe = pipe
        self._last = CameraStats(0, 0, 0.0, 0.0)

    @property
    def pid(self) -> int:
        """Its process id."""
        assert self._process.pid is not None
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.is_alive()

    def fault(self, fault: Fault) -> None:
        """Break the video: `freeze` repeats one picture, `cut` sends nothing, `resume` ends both.

        Raises:
            VideoError: the camera is not running any more.
        """
        self._order(fault)

    def stats(self) -> CameraStats:
        """How it is doing; the last known when it does not answer."""
        if self._process.is_alive():
            try:
                self._pipe.send("stats")
            except OSError:
                return self._last
            self._receive(2.0)
        return self._last

    def stop(self) -> CameraStats:
        """End it. Safe to call twice."""
        if self._process.is_alive():
            try:
                self._pipe.send("stop")
                self._receive(5.0)
            except OSError:
                _log.debug("the camera process had already ended")
            self._process.join(5.0)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(5.0)
        self._pipe.close()
        return self._last

    def _order(self, order: _Order) -> None:
        try:
            self._pipe.send(order)
        except OSError as error:
            raise VideoError("the simulated camera has ended") from error

    def _receive(self, timeout_s: float) -> None:
        try:
            if self._pipe.poll(timeout_s):
                answer = self._pipe.recv()
                if isinstance(answer, CameraStats):
                    self._last = answer
        except (EOFError, OSError):
            _log.debug("the camera process ended before it answered")


def start_camera(scenario: Scenario, truth_name: str, video_url: str) -> CameraProcess:
    """Start a camera; returns when its first frame is about to be taken.

    Args:
        scenario: what there is to see.
        truth_name: the `TruthRing` that the autopilot writes; mark 0 and mark 1 are set in it.
        video_url: where the video goes, such as ``udp://127.0.0.1:5600``.

    Raises:
        VideoError: it cannot render or send, or does not start.
    """
    return spawn_camera(scenario, truth_name, partial(_video_sender, video_url))


def _video_sender(video_url: str, scenario: Scenario, ring: TruthRing) -> VideoSender:
    del ring
    return VideoSender(video_url, scenario.camera)


def spawn_camera(scenario: Scenario, truth_name: str, make_sender: SenderMaker) -> CameraProcess:
    """Start a camera whose pictures go through any sender; returns when its first frame is about to be taken.

    Args:
        scenario: what there is to see.
        truth_name: the `TruthRing` that the aircraft writes; mark 0 and mark 1 are set in it.
        make_sender: makes the sender, in the camera's process; must survive pickling.

    Raises:
        VideoError: it cannot render or send, or does not start.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    arguments = (scenario, truth_name, make_sender, theirs)
    process = context.Process(target=_camera_main, args=arguments, name="sitl-camera", daemon=True)
    process.start()
    theirs.close()
    try:
        answer = ours.recv() if ours.poll(_START_PATIENCE_S) else VideoError("the simulated camera does not start")
    except EOFError:
        answer = VideoError("the simulated camera ended at its start", "see the messages above")
    if isinstance(answer, Exception):
        process.terminate()
        process.join(5.0)
        ours.close()
        raise answer
    return CameraProcess(process, ours)


def _camera_main(
    scenario: Scenario,
    truth_name: str,
    make_sender: SenderMaker,
    pipe: Connection,
) -> None:
    # Ctrl-C in a terminal reaches the whole group; our parent decides when we end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The other core belongs to the autopilot and the program under test.
    cv2.setNumThreads(1)
    try:
        ring = TruthRing.attach(truth_name)
        camera = CameraLoop(scenario, ring, make_sender(scenario, ring), pipe)
    except (VideoError, OSError, ValueError) as error:
        pipe.send(error if isinstance(error, VideoError) else VideoError(f"the simulated camera cannot start: {error}"))
        return
    try:
        camera.run()
    finally:
        camera.close()
        ring.close()


class CameraLoop:
    """The loop of a camera's process; closes the sender at its end."""

    def __init__(self, scenario: Scenario, ring: TruthRing, sender: PictureSender, pipe: Connection) -> None:
        self._scenario, self._ring, self._pipe = scenario, ring, pipe
        self._period_s = 1.0 / scenario.camera.fps
        self._half_s = 0.5 * (scenario.camera.exposure_ms + scenario.camera.readout_ms) / 1000.0
        self._airframe = CameraOnAirframe(scenario, ring)
        self._renderer = Renderer(scenario)
        self._darkroom = ExposurePipeline(self._renderer, sender)
        self._frozen = False
        self._frames = self._dropped = 0
        # The first picture compiles and caches: before the clock starts.
        self._renderer.expose(self._airframe.pose_at, time.monotonic(), None)
        self._start_s = time.monotonic() + self._period_s
        self._start_cpu_s = time.process_time()

    def run(self) -> None:
        """Take pictures until told to stop or the parent is gone."""
        self._ring.set_mark(CAMERA_MARK, self._start_s)
        if not self._renderer.world.waits_for_drone:
            self._ring.set_mark(WALK_MARK, self._start_s)
        self._pipe.send("ready")
        number = 0
        while self._wait_until(self._start_s + number * self._period_s):
            self._take(self._start_s + number * self._period_s)
            due = math.floor((time.monotonic() - self._start_s) / self._period_s)
            # One frame may be late; beyond that the missed ones are dropped.
            following = max(number + 1, due)
            self._dropped += following - number - 1
            number = following

    def close(self) -> None:
        """Close the stream."""
        self._darkroom.close()
        self._renderer.close()

    def _take(self, capture_s: float) -> None:
        newest = self._await_truth(capture_s + self._half_s)
        if newest is not None and self._ring.mark(WALK_MARK) is None and self._signal(newest):
            self._ring.set_mark(WALK_MARK, newest.t_s)
        light: Image | None = None
        if self._frames == 0 or not self._frozen:
            walk_s = self._ring.mark(WALK_MARK)
            light = self._renderer.draw(self._airframe.pose_at, capture_s, walk_s, self._start_s)
        self._darkroom.hand(light, capture_s, self._start_s)
        self._frames += 1

    def _signal(self, newest: VehicleTruth) -> bool:
        """Whether the drone does what people wait for."""
        if not self._scenario.walks_on_turn:
            return flies_sideways(newest)
        before = self._ring.at(newest.t_s - TURN_S)
        return flies_sideways(newest) or (before is not None and turns(before, newest))

    def _await_truth(self, until_s: float) -> VehicleTruth | None:
        """The newest truth, as soon as it reaches to a time; a silent autopilot is waited for only shortly."""
        give_up_s = until_s + _TRUTH_PATIENCE_S
        while True:
            newest = self._ring.newest()
            reached = newest is not None and newest.t_s >= until_s
            if reached or time.monotonic() > give_up_s or (newest is None and time.monotonic() >= until_s):
                return newest
            time.sleep(0.004)  # looks again until the truth is there or it is too late

    def _wait_until(self, t_s: float) -> bool:
        """Obey orders until a time; False when it is time to end."""
        while True:
            wait_s = t_s - time.monotonic()
            try:
                if not self._pipe.poll(max(0.0, wait_s)):
                    return True
                order: _Order = self._pipe.recv()
            except (EOFError, OSError):
                return False
            if order in ("stats", "stop"):
                self._pipe.send(self._stats())
            if order == "stop":
                return False
            if order in ("freeze", "resume"):
                self._frozen = order == "freeze"
            if order in ("cut", "resume"):
                self._darkroom.mute(order == "cut")

    def _stats(self) -> CameraStats:
        run_s = max(1e-3, time.monotonic() - self._start_s)
        return CameraStats(
            frames=self._frames,
            dropped=self._dropped,
            cpu_share=(time.process_time() - self._start_cpu_s) / run_s,
            delay_s=self._darkroom.delay_s,
        )
