"""KLV metadata: our own packets, damaged ones, and a real transport stream through FFmpeg."""

from __future__ import annotations

import math
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mission.errors import LogError
from mission.logs import read_log
from mission.logs.klv_local_set import KlvError, packets, parse_local_set
from mission.pose.buffer import heading
from sitl.recorded.klv_stream import local_set, write_transport_stream
from tests.mission.logs.test_kinds import TILT, flight

# From the MISB standard's own worked values (ST 0601, "example software value" of each item).
GOLDEN = bytes.fromhex(
    "060e2b34020b01010e01030101000000"  # key
    "27"  # length
    "02080004 59f4a6aa4aa8".replace(" ", "")  # 2008-10-24T00:13:29.913Z
    + "0502 71c2 0602 fd3d 0702 08b8".replace(" ", "")  # 159.974 deg, -0.4315 deg, 3.4058 deg
    + "0d04 5595b66d 0e04 5b5360c4".replace(" ", "")  # 60.17682 deg, 128.42676 deg
)


def with_checksum(body: bytes) -> bytes:
    whole = body + b"\x01\x02"
    total = sum(byte << (8 if place % 2 == 0 else 0) for place, byte in enumerate(whole))
    return whole + (total & 0xFFFF).to_bytes(2, "big")


def test_values_of_the_standard() -> None:
    body = GOLDEN[17:]
    told = parse_local_set(with_checksum(GOLDEN[:16] + bytes([len(body) + 4]) + body))
    assert told.time_s == pytest.approx(1224807209.913, abs=1e-3)
    assert told.heading_deg == pytest.approx(159.9744, abs=1e-4)
    assert told.pitch_deg == pytest.approx(-0.4315251, abs=1e-4)
    assert told.roll_deg == pytest.approx(3.405814, abs=2e-4)
    assert told.lat_deg == pytest.approx(60.176822967, abs=1e-7)
    assert told.lon_deg == pytest.approx(128.426759042, abs=1e-7)
    assert told.amsl_m is None


@given(st.integers(0, 200), st.integers(1, 255))
def test_any_flipped_byte_is_noticed(at: int, flip: int) -> None:
    packet = bytearray(local_set(flight(), 3))
    packet[at % len(packet)] ^= flip
    with pytest.raises(KlvError):
        parse_local_set(bytes(packet))


@given(st.integers(0, 150))
def test_cut_packets(length: int) -> None:
    packet = local_set(flight(), 3)
    with pytest.raises(KlvError):
        parse_local_set(packet[: min(length, len(packet) - 1)])


@given(st.binary(max_size=300))
def test_anything_else(data: bytes) -> None:
    assert list(packets(data)) == []


def picture_video(path: Path, frames: int, fps: int = 20) -> Path:
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=fps, options={"preset": "ultrafast", "bf": "0"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(frames):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), k % 255, np.uint8), "bgr24")
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


def test_transport_stream(tmp_path: Path) -> None:
    told = flight()
    video = picture_video(tmp_path / "v.mp4", len(told.t_s))
    write_transport_stream(tmp_path / "v.ts", video, told)
    log = read_log(tmp_path / "v.ts")
    assert log.kind == "misb-klv"
    assert log.clock == "video"
    assert log.utc_at_zero_s == pytest.approx(1.79e9 + 12.0, abs=0.01)
    pose = log.pose_at()(4.03)
    assert pose is not None
    roll, pitch, yaw = (float(np.interp(16.03, told.t_s, column)) for column in told.roll_pitch_yaw_rad.T)
    north, east, _ = Rotation.from_euler("ZYX", [yaw, pitch, roll]).apply([math.cos(TILT), 0.0, math.sin(TILT)])
    off = math.remainder(heading(pose.world_from_body_wxyz) - math.atan2(east, north), 2 * math.pi)
    assert off == pytest.approx(0.0, abs=0.003)
    assert log.gimbal is not None
    assert log.positions.enu_m[-1][1] == pytest.approx(1.5 * (told.t_s[-1] - 12.0), abs=0.2)


def test_stream_without_metadata(tmp_path: Path) -> None:
    video = picture_video(tmp_path / "v.ts", 40)
    with pytest.raises(LogError, match="no KLV stream"):
        read_log(video)
