"""The gimbal over MAVLink: what the autopilot sends of it is where its lens looks, by the mission's own reading."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from mission.gimbal.listener import GimbalListener
from mission.pose.buffer import PoseBuffer, world_from_body
from mission.records import Vector
from sitl.autopilot.config import AutopilotConfig, FlavourName
from sitl.autopilot.gimbal_settings import GimbalSettings, Tells
from tests.support.autopilot_bench import Bench, Peer

STATUS: int = mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS
PITCH_YAW, CONFIGURE = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
BIAS_DEG = 4.0


def carrying(flavour: FlavourName, settings: GimbalSettings) -> Bench:
    return Bench(AutopilotConfig(flavour=flavour, gimbal=settings, noise="none", heading_rad=0.7))


def point(bench: Bench, pitch_deg: float, yaw_deg: float) -> None:
    bench.peer.command(CONFIGURE, 255, 190, -1, -1, math.nan, math.nan, 0)
    assert bench.peer.command(PITCH_YAW, pitch_deg, yaw_deg, math.nan, math.nan, 16, 0, 0) == 0


def followed(bench: Bench, age_s: float, servo: bool, seconds: float) -> tuple[Vector, float, GimbalListener]:
    """World_from_gimbal as the mission reads it, half a second before the end; the time; the listener."""
    listener, poses = GimbalListener(age_s), PoseBuffer()
    listener.servo = servo
    assert bench.peer.ask_rate(STATUS, 20.0) == 0
    assert bench.peer.ask_rate(mavlink.MAVLINK_MSG_ID_ATTITUDE, 50.0) == 0
    boot_s = bench.autopilot.boot_s - bench.now
    for _ in range(round(seconds / 0.05)):
        bench.peer.received.clear()
        bench.run(0.05)
        for message in bench.peer.received:
            if message.get_type() == "ATTITUDE":
                poses.add_attitude(
                    message.time_boot_ms * 1e-3, world_from_body(message.roll, message.pitch, message.yaw)
                )
            if message.get_type() == "GIMBAL_DEVICE_ATTITUDE_STATUS":
                listener.take(message, bench.now)
    asked_s = bench.now - 0.5
    turned = listener.at(asked_s, lambda t_s: t_s + boot_s, poses.attitude_at)
    assert turned is not None
    return turned, asked_s, listener


@pytest.mark.parametrize("tells", ["nose", "north", "nose-delta"])
@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_the_mission_reads_where_the_lens_looks(flavour: FlavourName, tells: Tells) -> None:
    bench = carrying(flavour, GimbalSettings(tells="nose" if flavour == "ardupilot" else tells, yaw_bias_deg=BIAS_DEG))
    bench.hover()
    point(bench, -35.0, 100.0)
    bench.run(2.0)
    turned, _, listener = followed(bench, 0.05, servo=False, seconds=3.0)
    ahead = Rotation.from_quat(turned, scalar_first=True).apply([1.0, 0.0, 0.0])
    truth = bench.autopilot.truth.world_from_gimbal_wxyz
    assert truth is not None
    true = Rotation.from_quat(truth, scalar_first=True).apply([1.0, 0.0, 0.0])
    off = math.degrees(math.atan2(ahead[0], ahead[1]) - math.atan2(true[0], true[1]))
    assert off == pytest.approx(BIAS_DEG, abs=0.3)
    assert math.degrees(math.asin(ahead[2])) == pytest.approx(-35.0, abs=0.3)
    assert listener.doubt(bench.now) == ""


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_servos_are_seen_through_the_airframe(flavour: FlavourName) -> None:
    bench = carrying(flavour, GimbalSettings(kind="servo"))
    bench.hover()
    turned, _, listener = followed(bench, 0.0, servo=flavour == "ardupilot", seconds=3.0)
    truth = bench.autopilot.truth.world_from_gimbal_wxyz
    assert truth is not None
    apart = Rotation.from_quat(turned, scalar_first=True).inv() * Rotation.from_quat(truth, scalar_first=True)
    assert math.degrees(apart.magnitude()) < 5.0
    assert listener.doubt(bench.now)


def test_who_takes_the_gimbal_is_told_to_all() -> None:
    bench = carrying("px4", GimbalSettings())
    other = Peer(bench.autopilot, 250, 191)
    bench.hover()
    point(bench, -20.0, 40.0)
    other.command(CONFIGURE, 250, 191, -1, -1, math.nan, math.nan, 0)
    bench.peer.received.clear()
    bench.run(0.1)
    told = [m for m in bench.peer.received if m.get_type() == "GIMBAL_MANAGER_STATUS"]
    assert (told[-1].primary_control_sysid, told[-1].primary_control_compid) == (250, 191)
    assert bench.peer.command(PITCH_YAW, -20.0, 40.0, math.nan, math.nan, 16, 0, 0) == mavlink.MAV_RESULT_DENIED


def test_without_a_gimbal_there_is_none_of_its_messages() -> None:
    bench = Bench(AutopilotConfig(flavour="px4"))
    assert bench.peer.ask_rate(STATUS, 20.0) != 0
    assert bench.peer.command(CONFIGURE, 255, 190, -1, -1) == mavlink.MAV_RESULT_UNSUPPORTED


def test_its_configuration_reaches_the_process() -> None:
    config = AutopilotConfig(gimbal=GimbalSettings(tells="north", age_ms=80.0))
    assert AutopilotConfig.from_json(config.to_json()) == config
