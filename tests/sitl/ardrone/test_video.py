"""PaVE headers byte by byte, and what the video port does for fast and slow clients."""

from __future__ import annotations

import itertools
import socket
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import av
import numpy as np
import pytest
from av.codec.context import Flags
from av.video.codeccontext import VideoCodecContext

from sitl.ardrone.camera import video_format
from sitl.ardrone.configuration import Configuration
from sitl.ardrone.pave import FrameType, Pave, nal_type, nal_units
from sitl.ardrone.video import MOST_WAITING_BYTES, Encoder, VideoFormat, VideoServer
from tests.support.live_ardrone import bar_picture, until

FORM = VideoFormat(height_px=360, fps=10.0)


@dataclass
class Packet:
    codec: int
    header_bytes: int
    size_px: tuple[int, int]
    number: int
    timestamp_ms: int
    kind: int
    slices: tuple[int, int]
    payload: bytes


def packets(data: bytes) -> list[Packet]:
    """The packets of a stream, read as video_encapsulation.h describes them."""
    found = []
    while data:
        assert data[:4] == b"PaVE"
        codec, header_bytes, payload_bytes = struct.unpack_from("<BHI", data, 5)
        size = struct.unpack_from("<HH", data, 16)
        number, timestamp = struct.unpack_from("<II", data, 20)
        payload = data[header_bytes : header_bytes + payload_bytes]
        found.append(Packet(codec, header_bytes, size, number, timestamp, data[30], (data[42], data[43]), payload))
        data = data[header_bytes + payload_bytes :]
    return found


def test_golden_header() -> None:
    header = Pave(
        payload_bytes=0x1234,
        encoded_width_px=640,
        encoded_height_px=368,
        display_width_px=640,
        display_height_px=360,
        frame_number=258,
        timestamp_ms=1_000_000,
        frame_type=FrameType.P,
        stream_position=0x1_0000_0002,
        stream_id=3,
        slices=2,
        slice_index=1,
        sps_bytes=5,
        pps_bytes=4,
    )
    assert header.pack() == bytes.fromhex(
        "50615645 02 04 4000 34120000"  # PaVE, version 2, H.264, 64 bytes, payload
        "8002 7001 8002 6801"  # 640 x 368 encoded, 640 x 360 shown
        "02010000 40420f00"  # number, milliseconds
        "01 00 03 00"  # chunks, chunk, P, control
        "02000000 01000000"  # position, low and high
        "0300 02 01 05 04 0000"  # stream, slices, slice, SPS, PPS, reserved
        "00000000 000000000000000000000000"
    )


def test_longer_headers_end_in_zeros_and_say_their_length() -> None:
    header = Pave(1, 2, 3, 4, 5, 6, 7, FrameType.IDR, 0)
    long = header.pack(76)
    assert len(long) == 76
    assert struct.unpack_from("<H", long, 6) == (76,)
    assert long[64:] == bytes(12)


def test_nal_units_are_cut_at_start_codes_of_either_length() -> None:
    stream = b"\0\0\0\1\x67ab\0\0\1\x68c\0\0\0\1\x65def"
    assert nal_units(stream) == [b"\0\0\0\1\x67ab", b"\0\0\1\x68c", b"\0\0\0\1\x65def"]
    assert [nal_type(unit) for unit in nal_units(stream)] == [7, 8, 5]


def test_key_frames_carry_the_parameter_sets_and_come_once_a_second() -> None:
    encoder = Encoder(FORM)
    found = [packets(b"".join(encoder.encode(bar_picture(i), 0.1 * i)[0]))[0] for i in range(21)]
    assert [p.kind for p in found] == [FrameType.P if i % 10 else FrameType.IDR for i in range(21)]
    assert [nal_type(unit) for unit in nal_units(found[0].payload)] == [7, 8, 5]
    assert [nal_type(unit) for unit in nal_units(found[1].payload)] == [1]
    assert [p.number for p in found] == list(range(21))
    assert found[20].timestamp_ms == 2000


def test_slices_have_a_packet_each_and_make_one_picture_together() -> None:
    encoder = Encoder(VideoFormat(height_px=720, slices=3, bitrate_kbit_s=4000))
    found = packets(b"".join(encoder.encode(bar_picture(3), 0.0)[0]))
    assert [p.slices for p in found] == [(3, 0), (3, 1), (3, 2)]
    assert {p.number for p in found} == {0}
    decoder = av.CodecContext.create("h264", "r")
    assert isinstance(decoder, VideoCodecContext)
    decoder.flags |= Flags.low_delay
    frames = decoder.decode(av.Packet(b"".join(p.payload for p in found)))
    assert [(f.width, f.height) for f in frames] == [(1280, 720)]
    assert frames[0].to_ndarray(format="bgr24")[600, 200, 0] > 150


def test_a_new_format_begins_with_a_key_frame() -> None:
    encoder = Encoder(FORM)
    encoder.encode(bar_picture(0), 0.0)
    encoder.reform(VideoFormat(height_px=720, fps=10.0))
    (packet,) = packets(b"".join(encoder.encode(bar_picture(1), 0.1)[0]))
    assert packet.kind == FrameType.IDR
    assert packet.size_px == (1280, 720)


@pytest.fixture
def server() -> Iterator[VideoServer]:
    video = VideoServer("127.0.0.1", 0, FORM)
    yield video
    video.close()


def test_a_client_that_comes_late_starts_with_a_key_frame(server: VideoServer) -> None:
    with socket.create_connection(("127.0.0.1", server.port), 2.0) as first:
        assert until(lambda: server.clients == 1)
        server.send(bar_picture(0), 0.0)
        server.send(bar_picture(1), 0.1)
        with socket.create_connection(("127.0.0.1", server.port), 2.0) as second:
            assert until(lambda: server.clients == 2)
            server.send(bar_picture(2), 0.2)
            second.settimeout(2.0)
            (packet,) = packets(second.recv(1 << 20))
            assert packet.kind == FrameType.IDR
            assert packet.number == 2
        first.settimeout(2.0)
        assert first.recv(4) == b"PaVE"


def test_a_slow_client_loses_pictures_but_never_part_of_one(server: VideoServer) -> None:
    rng = np.random.default_rng(1)
    server.reform(VideoFormat(height_px=720, bitrate_kbit_s=20000, fps=10.0))
    with socket.socket() as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", server.port))
        assert until(lambda: server.clients == 1)
        sent = 0
        for number in range(40):
            noise = rng.integers(0, 255, (90, 160, 3), dtype=np.uint8).repeat(8, 0).repeat(8, 1)
            server.send(noise, 0.1 * number)
            sent += 1
        slow.settimeout(0.5)
        data = b""
        while True:
            try:
                data += slow.recv(1 << 20)
            except TimeoutError:
                break
        found = packets(data)
    numbers = [p.number for p in found]
    assert len(numbers) < sent
    assert len(data) < 4 * MOST_WAITING_BYTES + 8_000_000
    for before, after in itertools.pairwise(found):
        assert after.number == before.number + 1 or after.kind == FrameType.IDR


def test_a_client_that_hangs_up_is_forgotten(server: VideoServer) -> None:
    with socket.create_connection(("127.0.0.1", server.port), 2.0):
        assert until(lambda: server.clients == 1)

    def gone() -> bool:
        server.send(bar_picture(0), 0.0)
        return server.clients == 0

    assert until(gone)


def test_configuration_chooses_the_format() -> None:
    configuration = Configuration()
    assert video_format(configuration) == VideoFormat(360, 4000, 1, 30.0)
    configuration.set("video:video_codec", "131")
    configuration.set("video:bitrate_ctrl_mode", "2")
    configuration.set("video:bitrate", "1500")
    configuration.set("video:video_slices", "4")
    assert video_format(configuration) == VideoFormat(720, 1500, 4, 30.0)
