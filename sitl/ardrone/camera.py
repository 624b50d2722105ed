"""The aircraft's forward camera: the simulator's own, in a process of its own, behind the aircraft's video port."""

from __future__ import annotations

import logging
import multiprocessing
import socket
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection

from mission.errors import VideoError
from mission.records import Image
from sitl.aircraft.truth import TruthRing
from sitl.ardrone.configuration import Configuration, picture_height
from sitl.ardrone.video import VideoFormat, VideoServer
from sitl.camera.process import CAMERA_MARK, CameraProcess, spawn_camera
from sitl.scenario.schema import Scenario

_FIXED_BITRATE = 2
"""`video:bitrate_ctrl_mode`: `video:bitrate` holds; in the other modes `video:max_bitrate` is the limit."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class VideoPort:
    """Where the video is served, and how it is stamped."""

    host: str
    port: int
    booted_s: float
    """Monotonic time that the timestamps count from."""
    header_bytes: int


class PaveSender:
    """Sends the camera loop's pictures as the configuration asks for them."""

    def __init__(self, server: VideoServer, ring: TruthRing, booted_s: float, formats: Connection) -> None:
        self._server, self._ring, self._booted_s, self._formats = server, ring, booted_s, formats
        self.muted = False

    def send(self, picture: Image, capture_s: float) -> None:
        """Encode and send a picture taken `capture_s` after the camera's start."""
        while self._formats.poll():
            self._server.reform(self._formats.recv())
        started_s = self._ring.mark(CAMERA_MARK)
        if started_s is None:
            return
        self._server.muted = self.muted
        self._server.send(picture, started_s + capture_s - self._booted_s)
        self._formats.send(self._server.frames)

    def close(self) -> None:
        """Close the port."""
        self._server.close()


class ArdroneCamera:
    """The running camera, seen from the aircraft."""

    def __init__(self, process: CameraProcess, formats: Connection, port: int) -> None:
        self.process = process
        self.port = port
        self.frames = 0
        """Pictures taken so far."""
        self._formats = formats
        self._form: VideoFormat | None = None

    def obey(self, configuration: Configuration) -> None:
        """Pass on what the configuration says about the video, and hear how many pictures there were."""
        try:
            while self._formats.poll():
                self.frames = self._formats.recv()
            form = video_format(configuration)
            if form != self._form:
                self._formats.send(form)
                self._form = form
        except (EOFError, OSError):
            _log.debug("the camera process has ended")

    def stop(self) -> None:
        """End it. Safe to call twice."""
        self.process.stop()
        self._formats.close()


def video_format(configuration: Configuration) -> VideoFormat:
    """What the configuration says about the live video."""
    fixed = configuration.number("video:bitrate_ctrl_mode") == _FIXED_BITRATE
    return VideoFormat(
        height_px=picture_height(int(configuration.number("video:video_codec"))),
        bitrate_kbit_s=round(configuration.number("video:bitrate" if fixed else "video:max_bitrate")),
        slices=max(1, int(configuration.number("video:video_slices"))),
        fps=configuration.number("video:codec_fps"),
    )


def start_camera(scenario: Scenario, truth_name: str, where: VideoPort) -> ArdroneCamera:
    """Start the camera; returns when its first picture is about to be taken.

    Args:
        scenario: what there is to see; its camera is the aircraft's 720p camera.
        truth_name: of the `TruthRing` that the aircraft writes.
        where: the video port; 0 takes a free one.

    Raises:
        VideoError: it cannot render or listen, or does not start.
    """
    if where.port == 0:
        where = VideoPort(where.host, _free_tcp_port(where.host), where.booted_s, where.header_bytes)
    formats, their_formats = multiprocessing.get_context("spawn").Pipe()
    try:
        process = spawn_camera(scenario, truth_name, partial(_pave_sender, where, their_formats))
    except VideoError:
        formats.close()
        raise
    finally:
        their_formats.close()
    return ArdroneCamera(process, formats, where.port)


def _pave_sender(where: VideoPort, formats: Connection, scenario: Scenario, ring: TruthRing) -> PaveSender:
    form, delay_s = VideoFormat(fps=scenario.camera.fps), scenario.camera.extra_latency_ms / 1000.0
    server = VideoServer(where.host, where.port, form, where.header_bytes, delay_s=delay_s)
    return PaveSender(server, ring, where.booted_s, formats)


def _free_tcp_port(host: str) -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])
