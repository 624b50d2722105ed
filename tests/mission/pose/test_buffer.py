from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mission.clock import ClockMap
from mission.geodesy import geodetic_to_enu
from mission.pose.buffer import Pose, PoseBuffer, heading, hermite, slerp, world_from_body
from mission.records import GeodeticOrigin, Vector
from tests.support.tlog import ARDUCOPTER, PX4, messages

ONE = np.eye(3)


def _at(buffer: PoseBuffer, t_s: float) -> Pose | None:
    return buffer.at(t_s, 0.01 * ONE, 0.001 * ONE)


def _filled(rate_hz: float = 50.0, seconds: float = 2.0, attitude_lag_s: float = 0.007) -> PoseBuffer:
    """Flies a quarter circle of 2 m radius in `seconds`, nose along the track."""
    buffer = PoseBuffer()
    for i in range(round(rate_hz * seconds) + 1):
        t = i / rate_hz
        place, velocity, _ = _circle(t)
        buffer.add_position(t, place, velocity)
        buffer.add_attitude(t + attitude_lag_s, world_from_body(0.1, -0.05, _circle(t + attitude_lag_s)[2]))
    return buffer


def _circle(t_s: float) -> tuple[Vector, Vector, float]:
    a = math.pi / 4 * t_s
    place = np.array([2 - 2 * math.cos(a), 2 * math.sin(a), 3.0])
    return place, math.pi / 2 * np.array([math.sin(a), math.cos(a), 0.0]), a


def test_pose_between_messages_is_on_the_curve() -> None:
    buffer = _filled(rate_hz=5.0)
    for t in np.linspace(0.05, 1.95, 77):
        pose = _at(buffer, float(t))
        place, velocity, yaw = _circle(float(t))
        assert pose is not None
        assert np.linalg.norm(pose.position_enu_m - place) < 2e-4
        assert np.linalg.norm(pose.velocity_enu_m_s - velocity) < 5e-3
        assert heading(pose.world_from_body_wxyz) == pytest.approx(yaw, abs=1e-9)
        assert np.array_equal(pose.position_covariance_m2, 0.01 * ONE)


def test_no_pose_beyond_either_end_of_either_stream() -> None:
    buffer = _filled(attitude_lag_s=0.05)
    assert _at(buffer, 0.04) is None, "before the first attitude"
    assert _at(buffer, 0.05) is not None
    assert _at(buffer, 2.0) is not None
    assert _at(buffer, 2.01) is None, "after the newest position, though attitude goes on"


@pytest.mark.parametrize("stream", ["position", "attitude"])
def test_a_gap_in_either_stream_gives_no_pose(stream: str) -> None:
    buffer = PoseBuffer()
    for i in range(100):
        t = i * 0.02
        gap = 0.5 < t < 0.85
        if not (gap and stream == "position"):
            buffer.add_position(t, np.zeros(3), np.zeros(3))
        if not (gap and stream == "attitude"):
            buffer.add_attitude(t, np.array([1.0, 0, 0, 0]))
    assert _at(buffer, 0.45) is not None
    assert _at(buffer, 0.6) is None
    assert _at(buffer, 0.9) is not None


def test_memory_is_bounded_and_old_poses_go() -> None:
    buffer = PoseBuffer(keep_s=5.0, max_messages=400)
    for i in range(20_000):
        buffer.add_position(i * 0.01, np.zeros(3), np.zeros(3))
        buffer.add_attitude(i * 0.01, np.array([1.0, 0, 0, 0]))
    assert len(buffer._positions.times) <= 400
    assert len(buffer._attitudes.values) <= 400
    assert _at(buffer, 199.0) is not None
    assert _at(buffer, 150.0) is None


def test_late_repeated_and_broken_messages_are_refused() -> None:
    buffer = _filled()
    assert not buffer.add_position(1.0, np.ones(3), np.ones(3))
    assert not buffer.add_position(2.0, np.ones(3), np.ones(3))
    assert not buffer.add_position(3.0, np.array([math.nan, 0, 0]), np.ones(3))
    assert not buffer.add_position(math.inf, np.ones(3), np.ones(3))
    assert not buffer.add_attitude(3.0, np.zeros(4))
    assert not buffer.add_attitude(3.0, np.full(4, math.nan))
    assert buffer.add_position(2.02, np.ones(3), np.ones(3))


angles = st.floats(-3.1, 3.1)


@given(roll=angles, pitch=st.floats(-1.5, 1.5), yaw=angles)
def test_world_from_body_is_mavlinks_z_y_x_seen_from_enu(roll: float, pitch: float, yaw: float) -> None:
    enu_from_ned = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    expected = enu_from_ned @ Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    w, x, y, z = world_from_body(roll, pitch, yaw)
    assert Rotation.from_quat([x, y, z, w]).as_matrix() == pytest.approx(expected, abs=1e-9)


@given(a=st.tuples(angles, angles, angles), b=st.tuples(angles, angles, angles), u=st.floats(0, 1), flip=st.booleans())
def test_slerp_goes_the_short_way_at_even_speed(
    a: tuple[float, float, float], b: tuple[float, float, float], u: float, flip: bool
) -> None:
    q0, q1 = world_from_body(*a), world_from_body(*b)
    between = slerp(u, q0, -q1 if flip else q1)
    assert np.linalg.norm(between) == pytest.approx(1.0)
    whole = 2 * math.acos(min(1.0, abs(float(q0 @ q1))))
    part = 2 * math.acos(min(1.0, abs(float(q0 @ between))))
    assert part == pytest.approx(u * whole, abs=2e-7 if whole > 1e-3 else 1e-3)


def test_hermite_reproduces_any_cubic() -> None:
    def cubic(t: float) -> tuple[Vector, Vector]:
        return np.array([1 + 2 * t - t**2 + 0.5 * t**3]), np.array([2 - 2 * t + 1.5 * t**2])

    p0, v0 = cubic(0.4)
    p1, v1 = cubic(1.9)
    place, velocity = hermite(0.3, 1.5, p0, v0, p1, v1)
    assert place == pytest.approx(cubic(0.85)[0])
    assert velocity == pytest.approx(cubic(0.85)[1])


@dataclass(frozen=True)
class _Replay:
    """Reported minus true, at the time of each truth message between take-off and landing."""

    t_s: Vector
    position_m: Vector
    heading_rad: Vector
    tilt_rad: Vector
    missing: int


def _replay(path: Path, keep_every: int = 1) -> _Replay:
    """Feeds the log as it arrived, and asks for the pose at each truth message's time."""
    clock, buffer = ClockMap(), PoseBuffer(keep_s=60.0)
    origin: GeodeticOrigin | None = None
    truth: list[tuple[float, Vector, Vector]] = []
    counts = {"GLOBAL_POSITION_INT": 0, "ATTITUDE": 0}
    t = 0.0
    for arrived, m in messages(path):
        kind = m.get_type()
        if kind in counts:
            t = m.time_boot_ms * 1e-3
            clock.observe(t, arrived)
            counts[kind] += 1
            if counts[kind] % keep_every:
                continue
            if kind == "ATTITUDE":
                buffer.add_attitude(t, world_from_body(m.roll, m.pitch, m.yaw))
            else:
                origin = origin or GeodeticOrigin(m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3, "amsl")
                enu = geodetic_to_enu(m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3, origin)
                buffer.add_position(t, enu, np.array([m.vy, m.vx, -m.vz]) * 0.01)
        elif kind == "SIM_STATE" and origin:
            lat, lon = (m.lat_int * 1e-7, m.lon_int * 1e-7) if m.lat_int else (m.lat, m.lon)
            # SIM_STATE has no time of its own; it is sent together with ATTITUDE.
            truth.append((t, geodetic_to_enu(lat, lon, m.alt, origin), world_from_body(m.roll, m.pitch, m.yaw)))
        elif kind == "HIL_STATE_QUATERNION" and origin:
            w, x, y, z = m.attitude_quaternion
            r = Rotation.from_quat([x, y, z, w])
            yaw, pitch, roll = r.as_euler("ZYX")
            enu = geodetic_to_enu(m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3, origin)
            # PX4 leaves its time at 0: the time of arrival stands in.
            truth.append((clock.to_remote(arrived), enu, world_from_body(roll, pitch, yaw)))
    rows, missing = [], 0
    for t, place, attitude in truth:
        pose = buffer.at(t, ONE, ONE)
        if pose is None:
            missing += 1
            continue
        w, x, y, z = attitude
        w2, x2, y2, z2 = pose.world_from_body_wxyz
        error = (Rotation.from_quat([x, y, z, w]).inv() * Rotation.from_quat([x2, y2, z2, w2])).as_rotvec()
        rows.append((t, pose.position_enu_m - place, error[2], np.linalg.norm(error[:2])))
    return _Replay(
        np.array([r[0] for r in rows]),
        np.array([r[1] for r in rows]),
        np.array([r[2] for r in rows]),
        np.array([r[3] for r in rows]),
        missing,
    )


def _drift_rms(replay: _Replay, over_s: float) -> float:
    """Rms change of the horizontal position error over a time."""
    at = np.interp(replay.t_s + over_s, replay.t_s, np.arange(len(replay.t_s))).round().astype(int)
    moved = (replay.position_m[at] - replay.position_m)[replay.t_s < replay.t_s[-1] - over_s, :2]
    return float(np.sqrt((moved**2).sum(axis=1).mean()))


# reference: what the two real autopilots report against their truth (autopilot, drift over 2 s, heading std, tilt rms).
REAL = [(ARDUCOPTER, 0.06, 0.6, 0.4), (PX4, 0.25, 2.0, 2.5)]


@pytest.mark.parametrize(("path", "drift_m", "heading_deg", "tilt_deg"), REAL, ids=["ardupilot", "px4"])
def test_interpolated_pose_of_a_real_flight_is_as_good_as_the_autopilots_own(
    path: Path, drift_m: float, heading_deg: float, tilt_deg: float
) -> None:
    replay = _replay(path)
    assert replay.missing < 10
    assert _drift_rms(replay, 2.0) < drift_m
    assert math.degrees(float(replay.heading_rad.std())) < heading_deg
    assert math.degrees(float(np.sqrt((replay.tilt_rad**2).mean()))) < tilt_deg


@pytest.mark.parametrize("path", [ARDUCOPTER, PX4], ids=["ardupilot", "px4"])
def test_ten_messages_a_second_interpolate_to_what_fifty_said(path: Path) -> None:
    whole, thinned = _replay(path), _replay(path, keep_every=5)
    times = np.intersect1d(whole.t_s, thinned.t_s)
    a, b = np.searchsorted(whole.t_s, times), np.searchsorted(thinned.t_s, times)
    assert len(times) > 900
    off = np.linalg.norm(whole.position_m[a] - thinned.position_m[b], axis=1)
    assert float(np.sqrt((off**2).mean())) < 0.02
    turned = np.abs(whole.heading_rad[a] - thinned.heading_rad[b])
    assert math.degrees(float(np.percentile(turned, 99))) < 0.5


def test_the_poses_of_a_long_flight_are_kept_from_its_beginning() -> None:
    buffer = PoseBuffer()
    buffer.keep_for(120.0)
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(round(100.0 * 50.0)):
        buffer.add_position(k / 50.0, np.zeros(3), np.zeros(3))
        buffer.add_attitude(k / 50.0, upright)
    for kept in (buffer, buffer.snapshot()):
        assert kept.at(0.5, np.eye(3), np.eye(3)) is not None
        assert kept.at(99.5, np.eye(3), np.eye(3)) is not None
