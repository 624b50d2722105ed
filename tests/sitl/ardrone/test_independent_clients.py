"""A client from PyPI, written by others against real aircraft, flies the simulated one and reads its video."""

from __future__ import annotations

import socket

import av
import numpy as np
import pytest
from av.codec.context import Flags
from av.video.codeccontext import VideoCodecContext

from mission.records import Image
from sitl.ardrone.video import VideoFormat, VideoServer
from tests.support.live_ardrone import ANY_PORTS, bar_picture, flying, until

HOVERING = 4


def test_pyardrone_connects_takes_off_reads_navdata_moves_and_lands() -> None:
    pyardrone = pytest.importorskip("pyardrone", reason="test-only: pip install pyardrone==0.6.1")
    at = pyardrone.at
    # Without its video part, which would hand pictures to OpenCV's own network reader.
    client_type = type("Client", (pyardrone.HelperMixin, pyardrone.ARDroneBase), {})
    with flying(ANY_PORTS) as server:
        ports = server.ports
        client = client_type(host="127.0.0.1", at_port=ports.at, navdata_port=ports.navdata)
        try:
            assert client.navdata_ready.wait(3.0)
            assert client.state.navdata_bootstrap
            assert not client.state.fly_mask

            # All options first: pyardrone checks each one's size against the SDK's structures.
            client.send(at.CONFIG("general:navdata_demo", False))
            assert until(lambda: client.state.command_mask)
            client.send(at.CTRL(at.CTRL.mode.ACK_CONTROL_MODE))
            assert until(lambda: not client.state.command_mask)
            assert until(lambda: hasattr(client.navdata, "magneto") and hasattr(client.navdata, "wifi"))
            assert client.navdata.demo.ctrl_state >> 16 == 2
            assert client.navdata.demo.vbat_flying_percentage == 100
            first = client.navdata.time.time
            assert until(lambda: client.navdata.time.time > first)

            client.send(at.CONFIG("general:navdata_demo", True))
            assert until(lambda: client.state.navdata_demo_mask)
            client.send(at.FTRIM())
            client.takeoff()
            assert until(lambda: client.state.fly_mask)
            assert until(lambda: client.navdata.demo.ctrl_state >> 16 == HOVERING)
            assert 600 < client.navdata.demo.altitude < 1200

            client.move(left=1.0)
            assert until(lambda: client.navdata.demo.vy < -500.0, 3.0)
            assert client.navdata.demo.phi < -5000.0
            client.hover()
            assert until(lambda: client.navdata.demo.ctrl_state >> 16 == HOVERING)
            assert abs(client.navdata.demo.vy) < 400.0

            client.land()
            assert until(lambda: not client.state.fly_mask)
            assert not client.state.emergency_mask
        finally:
            client.close()


def test_pyardrone_s_header_structure_and_ffmpeg_read_the_video() -> None:
    PaVE = pytest.importorskip("pyardrone.video", reason="test-only: pip install pyardrone==0.6.1").PaVE
    video = VideoServer("127.0.0.1", 0, VideoFormat(fps=20.0))
    try:
        with socket.create_connection(("127.0.0.1", video.port), 3.0) as connection:
            stream = connection.makefile("rb")
            decoder = av.CodecContext.create("h264", "r")
            assert isinstance(decoder, VideoCodecContext)
            decoder.flags |= Flags.low_delay
            pictures: list[Image] = []
            for number in range(6):
                until(lambda: video.clients > 0)
                video.send(bar_picture(number), 100.0 + 0.05 * number)
                header = PaVE.from_buffer_copy(stream.read(64))
                assert bytes(np.asarray(header.signature, np.uint8)) == b"PaVE"
                assert (header.version, header.video_codec, header.header_size) == (2, 4, 64)
                assert (header.display_width, header.display_height) == (640, 360)
                assert header.encoded_stream_height == 368
                assert header.frame_number == number
                assert header.timestamp == 100_000 + 50 * number
                assert header.frame_type == (1 if number == 0 else 3)
                packet = av.Packet(stream.read(header.payload_size))
                pictures += [np.asarray(f.to_ndarray(format="rgb24"), np.uint8) for f in decoder.decode(packet)]
    finally:
        video.close()
    last = pictures[-1]
    assert last.shape == (360, 640, 3)
    assert last[300, 100, 2] > 150 > last[300, 100, 0]
    assert last[300, 500, 0] > 150 > last[300, 500, 2]
