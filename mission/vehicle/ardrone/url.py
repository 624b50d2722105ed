"""The AR.Drone's address as an operator writes it: ``ardrone://192.168.1.1``, with settings as a query."""

from __future__ import annotations

import math
from dataclasses import dataclass
from urllib.parse import parse_qsl, urlsplit

from mission.errors import SettingsError

SCHEME = "ardrone"
_EXAMPLE = (
    "Use ardrone://192.168.1.1, if need be with ?at=5556&navdata=5554&video=5555 (ports), declination=DEGREES (of the"
    " magnetic field, east positive), scale=FACTOR (true over reckoned travel), codec=360p or 720p, size=WIDTHxHEIGHT"
    " (pictures are scaled to it)"
)
_CODECS = {"360p": 0x81, "720p": 0x83}
"""video:video_codec: H264_360P_CODEC and H264_720P_CODEC."""


@dataclass(frozen=True, slots=True)
class ArdroneAddress:
    """Where an AR.Drone is, and what the operator wants of it."""

    host: str = "192.168.1.1"
    at_port: int = 5556
    navdata_port: int = 5554
    video_port: int = 5555
    declination_rad: float | None = None
    """Magnetic declination, east positive; None when nobody told it."""
    velocity_scale: float = 1.0
    """True over reckoned travel, from `sidestep calibrate baseline`."""
    codec: int = 0x81
    """video:video_codec."""
    size_px: tuple[int, int] | None = None
    """Width and height to which pictures are scaled; None leaves them."""


def is_ardrone(url: str) -> bool:
    """Whether the address is one of an AR.Drone."""
    return url.strip().lower().startswith(f"{SCHEME}:")


def ardrone_address(url: str) -> ArdroneAddress:
    """Read an address.

    Raises:
        SettingsError: it is none; the message says which part is wrong.
    """
    try:
        parts = urlsplit(url.strip())
        if parts.scheme.lower() != SCHEME or not parts.hostname or parts.port is not None or parts.path.strip("/"):
            raise ValueError("it is not of the form ardrone://HOST?NAME=VALUE")
        query = dict(parse_qsl(parts.query, keep_blank_values=True, strict_parsing=True) if parts.query else ())
        address = ArdroneAddress(
            parts.hostname,
            _port(query.pop("at", "5556")),
            _port(query.pop("navdata", "5554")),
            _port(query.pop("video", "5555")),
            _declination(query.pop("declination", None)),
            _scale(query.pop("scale", "1")),
            _codec(query.pop("codec", "360p")),
            _size(query.pop("size", None)),
        )
        if query:
            raise ValueError(f"{', '.join(sorted(query))} is not known")
    except ValueError as error:
        raise SettingsError(f"{url!r} is not an AR.Drone's address: {error}", _EXAMPLE) from error
    return address


def _port(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 65535:
        raise ValueError(f"the port {text!r} is not a number from 1 to 65535")
    return int(text)


def _declination(text: str | None) -> float | None:
    if text is None:
        return None
    degrees = float(text)
    if not abs(degrees) <= 180.0:
        raise ValueError(f"the declination {text!r} is not from -180 to 180 degrees")
    return math.radians(degrees)


def _scale(text: str) -> float:
    factor = float(text)
    if not 0.5 <= factor <= 2.0:
        raise ValueError(f"the scale {text!r} is not from 0.5 to 2")
    return factor


def _codec(text: str) -> int:
    if text not in _CODECS:
        raise ValueError(f"the codec {text!r} is neither 360p nor 720p")
    return _CODECS[text]


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 16 <= int(width) <= 4096 and 16 <= int(height) <= 4096):
        raise ValueError(f"the size {text!r} is not WIDTHxHEIGHT in pixels")
    return int(width), int(height)
