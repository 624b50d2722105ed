"""How a video is doing."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class VideoState(Enum):
    """What the source is doing."""

    CONNECTING = "connecting"
    PLAYING = "playing"
    RECONNECTING = "reconnecting"
    ENDED = "ended"
    """A file is over, or cannot be read any further."""
    CLOSED = "closed"


@dataclass(frozen=True, slots=True)
class VideoStats:
    """How the video is doing."""

    state: VideoState
    fps: float
    """Frames decoded per second over the last two seconds."""
    decoded: int
    dropped: int
    """Decoded, but replaced by a newer frame before anybody asked."""
    damaged: int
    """Packets or frames that the decoder could not make a whole picture of."""
    reconnects: int
    last_frame_age_s: float | None
    """Since the newest frame arrived; None before the first."""
    decode_s: float
    """Mean time for decoding a frame and turning it into BGR."""
    error: str
    """Why it is not playing; empty while it is."""
    note: str = ""
    """What is wrong with the stream and was put right, for the operator; empty where nothing is."""
    codec: str = ""
    """FFmpeg's name of how it is encoded; empty before it was opened."""
