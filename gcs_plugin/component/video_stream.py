"""A video's address in the forms in which stations open one: VIDEO_STREAM_INFORMATION (269).

MAVLink gives the address of a server to connect to (RTSP, TCP), or the number of the UDP port to listen on.
QGroundControl makes ``mpegts://0.0.0.0:PORT``, ``udp://0.0.0.0:PORT`` (RTP, H.264) or ``udp265://0.0.0.0:PORT`` of a
number, and opens what already begins like that as it is (`VideoManager::_updateAutoStream`).

What a station cannot open is not announced: files and devices, addresses of this computer alone, protocols that MAVLink
has no type for. Nor is an address with a password, because anybody may ask for it.
"""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import all as mavlink

from mission.addresses import has_secret

MOST_BYTES: Final = 160
"""Of `uri`, with the zero at its end."""
_ENCODINGS: Final = {
    "h264": mavlink.VIDEO_STREAM_ENCODING_H264,
    "hevc": mavlink.VIDEO_STREAM_ENCODING_H265,
    "h265": mavlink.VIDEO_STREAM_ENCODING_H265,
}
_UDP: Final = re.compile(r"@?(?P<host>\[[0-9A-Fa-f:.]+\]|[^:/?\s]*):(?P<port>\d{1,5})(?:[/?].*)?")
_MPEG_TS: Final = ("udp", "mpegts")
_RTP: Final = ("rtp", "udp264", "udp265")


@dataclass(frozen=True, slots=True)
class VideoStream:
    """What stations are told."""

    kind: int
    """VIDEO_STREAM_TYPE."""
    uri: str
    encoding: int
    """VIDEO_STREAM_ENCODING."""


def video_stream(address: str, codec: str = "") -> VideoStream | None:
    """What to announce for an address that FFmpeg opens, None where stations could not open it.

    Args:
        address: also ``mpegts://``, and ``udp265://`` for RTP, as QGroundControl writes them.
        codec: FFmpeg's name of the video's codec; empty when it is not known.
    """
    scheme, separator, rest = address.strip().partition("://")
    scheme = scheme.lower()
    if not separator or has_secret(address):
        return None
    encoding = _ENCODINGS.get("hevc" if scheme == "udp265" else codec.lower(), mavlink.VIDEO_STREAM_ENCODING_UNKNOWN)
    if scheme in (*_MPEG_TS, *_RTP):
        return _over_udp(scheme, rest, int(encoding))
    kinds = {
        "rtsp": mavlink.VIDEO_STREAM_TYPE_RTSP,
        "rtsps": mavlink.VIDEO_STREAM_TYPE_RTSP,
        "tcp": mavlink.VIDEO_STREAM_TYPE_TCP_MPEG,
    }
    host = re.split(r"[/?#]", rest)[0]
    host = host if host.endswith("]") else re.sub(r":\d*$", "", host)
    listens = scheme == "tcp" and "listen" in rest.partition("?")[2]
    if scheme not in kinds or _here_only(host) or listens or len(address.strip().encode()) >= MOST_BYTES:
        return None
    return VideoStream(int(kinds[scheme]), address.strip(), int(encoding))


def _over_udp(scheme: str, rest: str, encoding: int) -> VideoStream | None:
    found = _UDP.fullmatch(rest)
    if found is None or not 0 < int(found["port"]) < 65536:
        return None
    host, port = found["host"], found["port"]
    anywhere = host in ("", "0.0.0.0", "[::]")
    if not anywhere and _here_only(host):
        return None
    kind = mavlink.VIDEO_STREAM_TYPE_MPEG_TS if scheme in _MPEG_TS else mavlink.VIDEO_STREAM_TYPE_RTPUDP
    if not _is_group(host):
        return VideoStream(int(kind), port, encoding)
    rtp = "udp265" if encoding == mavlink.VIDEO_STREAM_ENCODING_H265 else "udp"
    form = "mpegts" if scheme in _MPEG_TS else rtp
    return VideoStream(int(kind), f"{form}://{host}:{port}", encoding)


def _ip(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return None


def _is_group(host: str) -> bool:
    address = _ip(host)
    return address is not None and address.is_multicast


def _here_only(host: str) -> bool:
    """Whether only this computer finds anything there."""
    address = _ip(host)
    if address is None:
        return host == "" or host.lower().rstrip(".") == "localhost"
    return address.is_loopback or address.is_unspecified
