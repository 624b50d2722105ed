"""Opening a stream or a file through FFmpeg (PyAV), with the options that keep a live stream's delay small."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import av
import av.error
from av.codec.context import Flags
from av.container import InputContainer
from av.video.stream import VideoStream

from mission.addresses import shown_address
from mission.errors import VideoError

_UNTIMED_FORMATS = frozenset({"h264", "hevc", "m4v", "mjpeg", "mpjpeg", "image2pipe", "rawvideo"})
"""Live streams in these carry no times; FFmpeg makes them up from a frame rate that it guesses."""

_LIVE_OPTIONS: Mapping[str, str] = {
    # Stop probing as soon as the stream is known. `fflags=nobuffer` is left out on purpose: it throws away what was
    # read while probing, the key frame with it, and saves no delay later (measured: the same 1-2 frames).
    "probesize": "100000",
    "analyzeduration": "1",  # microseconds; 0 would mean FFmpeg's own 5 s
    "flags": "low_delay",
    # RTP: at most 0.1 s of waiting for packets out of order.
    "max_delay": "100000",
    "rtsp_flags": "prefer_tcp",
    # Survive a decoder that is held up for a moment (bytes; the kernel may give less).
    "buffer_size": "1048576",
}


@dataclass(frozen=True, slots=True, eq=False)
class Input:
    """An opened stream or file."""

    container: InputContainer
    stream: VideoStream
    timed: bool
    """Whether its presentation times can be believed."""
    frame_s: float
    """Duration of a frame as far as the file tells."""


def is_live(url: str) -> bool:
    """Whether the URL is a stream that runs by itself, rather than a file or a folder of pictures."""
    if url.lower().endswith(".sdp"):
        return True
    scheme, separator, _ = url.partition("://")
    return bool(separator) and scheme.lower() != "file"


def open_input(url: str, options: Mapping[str, str], open_timeout_s: float, read_timeout_s: float) -> Input:
    """Open a URL or file and find its first video stream.

    Args:
        url: what FFmpeg takes: rtsp://, udp://, http://, a file, an SDP file, a pattern like ``folder/%04d.png``.
        options: FFmpeg options, over the ones set here.
        open_timeout_s: longest time for each of the two steps of opening (connect, look at the streams).
        read_timeout_s: longest silence later.

    Raises:
        VideoError: there is no video stream in it.
        av.error.FFmpegError: FFmpeg refuses it.
        OSError: the system refuses it.
    """
    live = is_live(url)
    chosen: dict[str, str] = dict(_LIVE_OPTIONS) if live else {}
    if url.lower().endswith(".sdp"):
        chosen["protocol_whitelist"] = "file,udp,rtp,rtcp,tcp,crypto,data"
    chosen.update(options)
    container = av.open(url, options=chosen, timeout=(open_timeout_s, read_timeout_s))
    try:
        if not container.streams.video:
            raise VideoError(
                f"There is no video in {shown_address(url)}", "Check which of the camera's streams this is."
            )
        stream = container.streams.video[0]
        if stream.codec_context is None:
            raise VideoError(f"The video in {shown_address(url)} is of an unknown kind", "Let the camera send H.264.")
        if live:
            # Frame threads would hold back one frame per thread.
            stream.thread_type = "SLICE"
            stream.codec_context.flags |= Flags.low_delay
    except BaseException:
        container.close()
        raise
    rate = stream.average_rate or stream.guessed_rate
    timed = not (live and container.format.name in _UNTIMED_FORMATS)
    return Input(container, stream, timed, float(1 / rate) if rate else 0.05)


def explain(url: str, error: Exception, live: bool) -> VideoError:
    """What to tell the operator about a failure to open."""
    name = shown_address(url)
    if isinstance(error, VideoError):
        return error
    if isinstance(error, FileNotFoundError):
        return VideoError(f"The video {name} does not exist", "Check the path.")
    if isinstance(error, PermissionError):
        return VideoError(f"The video {name} may not be read", "Check its permissions.")
    if isinstance(error, (av.error.ProtocolNotFoundError, av.error.DemuxerNotFoundError)):
        return VideoError(f"FFmpeg does not know how to read {name}", "Check the part before ://.")
    if isinstance(error, (av.error.HTTPUnauthorizedError, av.error.HTTPForbiddenError)):
        return VideoError(f"The camera refuses access to {name}", "Put user and password into the URL.")
    if isinstance(error, av.error.HTTPNotFoundError):
        return VideoError(f"The camera has no stream at {name}", "Check the path in the URL.")
    if isinstance(error, ConnectionRefusedError):
        return VideoError(f"Nothing listens at {name}", "Check address and port, and that the camera is on.")
    if isinstance(error, (av.error.InvalidDataError, av.error.EOFError)):
        if live:
            return VideoError(f"What arrives at {name} is not a video", "Check what is sent to this port.")
        return VideoError(f"The file {name} is not a video", "Check the path.")
    if isinstance(error, (av.error.ExitError, TimeoutError)):
        return VideoError(
            f"No video arrives at {name}",
            "Check that the camera is on and sends to this address and port, and that no firewall is in between.",
        )
    in_use = "in use" in str(error)
    remedy = "Stop the other program that listens there." if in_use else "Check the URL and the network."
    return VideoError(f"The video {name} cannot be opened: {getattr(error, 'strerror', None) or error}", remedy)


def missing_file(url: str) -> Literal["file", "folder"] | None:
    """Which part of a recorded video's path does not exist; None for a live stream or when all is there."""
    if is_live(url) and not url.lower().endswith(".sdp"):
        return None
    path = Path(url.removeprefix("file://"))
    if "%" in path.name or "*" in path.name:
        return None if path.parent.is_dir() else "folder"
    return None if path.exists() else "file"
