"""The same flight through every kind of log says the same."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mission.errors import LogError
from mission.logs import PoseLog, read_log
from mission.pose.buffer import heading
from mission.records import Vector
from sitl.recorded.log_files import write_csv, write_dataflash, write_dji_srt, write_tlog, write_ulog
from sitl.recorded.reports import Reports
from tests.support.tlog import ARDUCOPTER, PX4

RATE_HZ = 20.0
TILT = math.radians(20.0)


def flight(duration_s: float = 8.0) -> Reports:
    t = np.arange(0.0, duration_s, 1.0 / RATE_HZ) + 12.0
    east, north = 3.0 * np.sin(0.4 * t), 1.5 * t
    lat0, lon0 = 47.4, 8.55
    metres = math.radians(1.0) * 6371e3
    place = np.column_stack([lat0 + north / metres, lon0 + east / metres / math.cos(math.radians(lat0)), 500 + 0.2 * t])
    speed = np.column_stack([1.2 * np.cos(0.4 * t), np.full_like(t, 1.5), np.full_like(t, 0.2)])
    angles = np.column_stack([0.05 * np.sin(t), 0.03 * np.cos(t), 3.0 + 0.3 * np.sin(0.8 * t)])
    return Reports(t, place, speed, angles, place[:, 2] - 490.0, tilt_down_rad=TILT)


def srt(path: Path, reports: Reports) -> None:
    write_dji_srt(path, reports, (reports.t_s - reports.t_s[0]).tolist())


WRITERS: dict[str, tuple[str, Callable[[Path, Reports], None]]] = {
    "tlog": ("a.tlog", write_tlog),
    "dataflash": ("a.bin", write_dataflash),
    "ulog": ("a.ulg", write_ulog),
    "dji-srt": ("a.SRT", srt),
    "csv": ("a.csv", write_csv),
}


@pytest.fixture(params=list(WRITERS))
def read(request: pytest.FixtureRequest, tmp_path: Path) -> PoseLog:
    name, write = WRITERS[request.param]
    write(tmp_path / name, flight())
    log = read_log(tmp_path / name)
    assert log.kind == request.param
    return log


def begin_s(log: PoseLog) -> float:
    """Of the log's clock when the vehicle's says 12 s."""
    return 0.0 if log.clock == "video" else 12.0


def test_path(read: PoseLog) -> None:
    told = flight()
    where = read.positions.enu_m - read.positions.enu_m[0]
    along = np.interp(read.positions.t_s - begin_s(read) + 12.0, told.t_s, 1.5 * told.t_s)
    assert np.abs(where[:, 1] - (along - along[0])).max() < 0.15  # SRT rounds to 0.11 m
    assert read.positions.velocity_m_s[20:-20, 1] == pytest.approx(1.5, abs=0.12)


def test_attitude(read: PoseLog) -> None:
    told = flight()
    pose_at = read.pose_at()
    for t_s in (14.02, 16.51, 18.33):
        pose = pose_at(t_s - 12.0 + begin_s(read))
        assert pose is not None
        _, pitch, yaw = (float(np.interp(t_s, told.t_s, column)) for column in told.roll_pitch_yaw_rad.T)
        tilt = TILT if read.gimbal is not None else 0.0
        assert math.remainder(heading(pose.world_from_body_wxyz) - yaw, 2 * math.pi) == pytest.approx(0.0, abs=0.005)
        forward = Rotation.from_quat(pose.world_from_body_wxyz, scalar_first=True).apply([1.0, 0.0, 0.0])
        assert math.asin(forward[2]) == pytest.approx(pitch - tilt, abs=0.003)


def test_time_and_accuracy(read: PoseLog) -> None:
    if read.kind != "dji-srt":  # local time without a zone
        assert read.utc_at_zero_s == pytest.approx(1.79e9, abs=0.05)
        assert read.accuracy_m == pytest.approx(0.3)
    assert read.take_off_up_m == pytest.approx(490.0 - (500 + 0.2 * 12.0), abs=0.05)


def test_gap_has_no_pose(tmp_path: Path) -> None:
    whole = flight(12.0)
    hole = (whole.t_s < 16.0) | (whole.t_s > 19.0)
    seen = Reports(
        whole.t_s[hole],
        whole.lat_lon_amsl[hole],
        whole.velocity_enu_m_s[hole],
        whole.roll_pitch_yaw_rad[hole],
        whole.height_m[hole],
    )
    write_tlog(tmp_path / "a.tlog", seen)
    log = read_log(tmp_path / "a.tlog")
    pose_at = log.pose_at()
    assert pose_at(15.5) is not None
    assert pose_at(17.0) is None
    assert pose_at(20.0) is not None
    assert log.gaps()[0] == pytest.approx((15.95, 19.05), abs=0.06)


@pytest.mark.parametrize("path", [ARDUCOPTER, PX4])
def test_recorded_telemetry(path: Path) -> None:
    log = read_log(path)
    assert len(log.positions.t_s) > 500
    up: Vector = log.positions.enu_m[:, 2]
    assert 2.0 < up.max() < 4.5
    assert log.aircraft is not None
    assert not log.gaps() or log.gaps()[0][1] - log.gaps()[0][0] < 5.0


def test_no_attitude_is_told(tmp_path: Path) -> None:
    cue = (
        "{n}\n00:00:{n:02d},000 --> 00:00:{m:02d},000\n"
        "[latitude: 59.3{n:02d}] [longitude: 18.2] [rel_alt: 1.3 abs_alt: 132.8]\n"
    )
    (tmp_path / "a.srt").write_text("\n".join(cue.format(n=n, m=n + 1) for n in range(20)))
    log = read_log(tmp_path / "a.srt")
    assert log.pointing is None
    with pytest.raises(LogError, match="neither the aircraft's attitude"):
        log.pose_at()
