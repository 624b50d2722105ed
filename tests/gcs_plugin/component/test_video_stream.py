"""The video's address as stations are told of it: what QGroundControl makes of it is what opens."""

from __future__ import annotations

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component.video_stream import video_stream
from tests.support.component_bench import Bench

RTSP, RTP, TCP, MPEG_TS = (
    mavlink.VIDEO_STREAM_TYPE_RTSP,
    mavlink.VIDEO_STREAM_TYPE_RTPUDP,
    mavlink.VIDEO_STREAM_TYPE_TCP_MPEG,
    mavlink.VIDEO_STREAM_TYPE_MPEG_TS,
)
H264, H265 = mavlink.VIDEO_STREAM_ENCODING_H264, mavlink.VIDEO_STREAM_ENCODING_H265


def opened_by_qgroundcontrol(kind: int, uri: str, encoding: int) -> str:
    """What `VideoManager::_updateAutoStream` makes of VIDEO_STREAM_INFORMATION."""
    if kind == RTP:
        scheme = "udp265" if encoding == H265 else "udp"
    elif kind == MPEG_TS:
        scheme = "mpegts"
    else:
        return uri
    return uri if f"{scheme}://" in uri else f"{scheme}://0.0.0.0:{uri}"


@pytest.mark.parametrize(
    ("address", "codec", "opened"),
    [
        ("rtsp://192.168.0.10:8554/main", "", "rtsp://192.168.0.10:8554/main"),
        ("RTSP://[fe80::1]:554/1", "hevc", "RTSP://[fe80::1]:554/1"),
        ("tcp://192.168.0.10:5000", "h264", "tcp://192.168.0.10:5000"),
        ("udp://0.0.0.0:5600", "h264", "mpegts://0.0.0.0:5600"),
        ("udp://:5600", "", "mpegts://0.0.0.0:5600"),
        ("udp://192.168.0.2:5600?pkt_size=1316", "", "mpegts://0.0.0.0:5600"),
        ("mpegts://0.0.0.0:5600", "", "mpegts://0.0.0.0:5600"),
        ("udp://@239.1.1.1:5600", "hevc", "mpegts://239.1.1.1:5600"),
        ("rtp://0.0.0.0:5600", "h264", "udp://0.0.0.0:5600"),
        ("rtp://239.1.1.1:5004", "h264", "udp://239.1.1.1:5004"),
        ("rtp://0.0.0.0:5600", "hevc", "udp265://0.0.0.0:5600"),
        ("rtp://239.1.1.1:5004", "hevc", "udp265://239.1.1.1:5004"),
        ("udp265://0.0.0.0:5600", "", "udp265://0.0.0.0:5600"),
    ],
)
def test_what_a_station_opens_is_where_the_video_is(address: str, codec: str, opened: str) -> None:
    stream = video_stream(address, codec)
    assert stream is not None
    assert opened_by_qgroundcontrol(stream.kind, stream.uri, stream.encoding) == opened


@pytest.mark.parametrize(
    "address",
    [
        "",
        "session.sdp",
        "/dev/video0",
        "file:///flight.mp4",
        "flight/%04d.png",
        "udp://127.0.0.1:5600",
        "rtsp://127.0.0.1:8554/main",
        "rtsp://localhost/main",
        "rtsp://[::1]:554/main",
        "tcp://0.0.0.0:5000?listen",
        "tcp://192.168.0.2:5000?listen=1",
        "srt://192.168.0.10:9000",
        "http://192.168.0.10/stream.mjpg",
        "ardrone://192.168.1.1",
        "udp://192.168.0.2:99999",
        "udp://192.168.0.2",
        "rtsp://pilot:s3cr3t@192.168.0.10/live",
        "rtsp://192.168.0.10/live?token=s3cr3t",
        f"rtsp://192.168.0.10/{'x' * 160}",
    ],
)
def test_what_a_station_cannot_open_or_may_not_know_is_not_announced(address: str) -> None:
    assert video_stream(address) is None
    bench = Bench()
    bench.component.picture = replace(bench.component.picture, url=address)
    for message_id in (mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION, mavlink.MAVLINK_MSG_ID_VIDEO_STREAM_STATUS):
        bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id)
    bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION)
    bench.turn()
    assert bench.take("VIDEO_STREAM_INFORMATION", "VIDEO_STREAM_STATUS") == []
    (camera,) = bench.take("CAMERA_INFORMATION")
    assert not camera.flags & mavlink.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM
    assert (camera.resolution_h, camera.resolution_v) == (640, 480)


@pytest.mark.parametrize(("codec", "encoding"), [("", 0), ("h264", H264), ("hevc", H265), ("mjpeg", 0)])
def test_the_encoding_is_named_once_it_is_known(codec: str, encoding: int) -> None:
    bench = Bench()
    bench.component.picture = replace(bench.component.picture, codec=codec)
    bench.command(mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION, 1.0)
    bench.turn()
    (stream,) = bench.take("VIDEO_STREAM_INFORMATION")
    assert stream.encoding == encoding


def test_qgroundcontrol_shows_its_camera_tracking_switch() -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION, 1.0)
    bench.turn()
    (camera,) = bench.take("CAMERA_INFORMATION")
    assert camera.flags & mavlink.CAMERA_CAP_FLAGS_CAPTURE_VIDEO
