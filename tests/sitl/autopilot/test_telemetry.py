"""What is reported: altitudes and their datums, readiness, home, and the quirks of PX4's home altitude."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.records import GeodeticOrigin
from sitl.autopilot import telemetry
from sitl.autopilot.airframe import Wind
from sitl.autopilot.config import AutopilotConfig
from tests.support.autopilot_bench import Bench

GLOBAL: int = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT


def relative_altitudes(noise: str) -> tuple[list[float], list[float]]:
    config = AutopilotConfig(flavour="px4", noise="rough" if noise == "rough" else "good")
    bench = Bench(config)
    bench.hover()
    bench.peer.ask_rate(GLOBAL, 5.0)
    bench.peer.received.clear()
    bench.run(8.0)
    told = bench.peer.of("GLOBAL_POSITION_INT")
    return [m.relative_alt / 1e3 for m in told], [m.alt / 1e3 for m in told]


def test_px4_moves_its_home_altitude_in_steps_when_gnss_is_noisy_but_not_its_absolute_altitude() -> None:
    relative, absolute = relative_altitudes("rough")
    assert np.abs(np.diff(relative)).max() > 0.5
    assert np.abs(np.diff(absolute)).max() < 0.3
    relative, _ = relative_altitudes("good")
    assert np.abs(np.diff(relative)).max() < 0.1


def test_altitudes_are_above_the_sea_and_ardupilot_s_receiver_also_tells_the_ellipsoids(bench: Bench) -> None:
    bench.hover(4.0)
    bench.peer.command(mavlink.MAV_CMD_REQUEST_MESSAGE, GLOBAL)
    bench.peer.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT)
    position, gnss = bench.peer.of("GLOBAL_POSITION_INT")[-1], bench.peer.of("GPS_RAW_INT")[-1]
    assert position.alt / 1e3 == pytest.approx(34.0, abs=0.4)
    assert position.relative_alt / 1e3 == pytest.approx(4.0, abs=0.4)
    px4 = bench.autopilot.flavour.name == "px4"  # whose SIH repeats the altitude above the sea
    assert (gnss.alt_ellipsoid - gnss.alt) / 1e3 == pytest.approx(0.0 if px4 else 23.0)
    assert gnss.h_acc > 0


def test_a_home_given_above_the_ellipsoid_is_taken_down_to_the_sea() -> None:
    config = AutopilotConfig(home=GeodeticOrigin(47.0, 8.0, 453.0, "ellipsoid"), geoid_separation_m=48.0)
    assert config.home_alt_amsl_m == pytest.approx(405.0)


def test_readiness_shows_in_the_prearm_bit_and_in_ardupilots_ekf_flags(bench: Bench) -> None:
    def prearm() -> bool:
        bench.peer.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SYS_STATUS)
        health = bench.peer.of("SYS_STATUS")[-1].onboard_control_sensors_health
        return bool(health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)

    def ekf() -> bool:
        bench.peer.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT)
        return bool(bench.peer.of("EKF_STATUS_REPORT")[-1].flags & 0x218 == 0x218)

    ardupilot = bench.autopilot.flavour.name == "ardupilot"
    bench.run(1.0)
    assert not prearm()
    assert not ardupilot or not ekf()
    bench.run(2.5)
    assert prearm()
    assert not ardupilot or ekf()


def test_the_two_attitude_messages_agree_and_the_heading_is_clockwise_from_north() -> None:
    config = AutopilotConfig(noise="none", heading_rad=math.radians(120.0))
    bench = Bench(config)
    bench.hover()
    bench.run(0.5)
    quaternion = telemetry.attitude_quaternion(bench.autopilot)
    w, x, y, z = quaternion.q1, quaternion.q2, quaternion.q3, quaternion.q4
    told = telemetry.attitude(bench.autopilot)
    assert math.degrees(told.yaw) == pytest.approx(120.0, abs=0.5)
    assert math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) == pytest.approx(told.yaw, abs=1e-6)
    assert telemetry.global_position_int(bench.autopilot).hdg == pytest.approx(12000, abs=50)


def test_a_configuration_survives_the_way_to_the_process() -> None:
    config = replace(
        AutopilotConfig(),
        flavour="ardupilot",
        wind=Wind((1.0, -2.0, 0.0), 0.5),
        parameters=(("FENCE_RADIUS", 50.0),),
        home=GeodeticOrigin(1.0, 2.0, 3.0, "amsl"),
    )
    assert AutopilotConfig.from_json(config.to_json()) == config


def test_two_flights_with_one_seed_are_the_same_and_with_another_differ() -> None:
    def path(seed: int) -> list[float]:
        bench = Bench(AutopilotConfig(seed=seed, wind=Wind((1.0, 0.0, 0.0), 0.8)))
        bench.hover()
        bench.run(1.0)
        return [float(x) for x in bench.autopilot.truth.position_enu_m]

    assert path(7) == path(7)
    assert path(7) != path(8)
