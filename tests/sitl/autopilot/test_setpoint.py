"""Masks and frames of setpoints, read as each autopilot reads them."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink
from pyproj import Transformer

from sitl.autopilot.flavour import ARDUPILOT, PX4
from sitl.autopilot.flight_controller import EstimatedState
from sitl.autopilot.local_frame import LocalFrame
from sitl.autopilot.setpoint import global_setpoint, local_setpoint
from tests.support.autopilot_bench import IGNORE_POSITION, IGNORE_YAW_RATE, setpoint

STATE = EstimatedState((10.0, 20.0, 30.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), math.pi / 2)
"""Heading east."""


def test_north_east_down_becomes_east_north_up() -> None:
    demand = local_setpoint(setpoint((1.0, 2.0, -3.0), (4.0, 5.0, -6.0), yaw=0.5), PX4, STATE)
    assert demand is not None
    assert demand.position == (2.0, 1.0, 3.0)
    assert demand.velocity == (5.0, 4.0, 6.0)
    assert demand.yaw == pytest.approx(0.5)
    assert demand.yaw_rate is None


@pytest.mark.parametrize("flavour", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
def test_body_velocities_turn_with_the_nose(flavour: object) -> None:
    message = setpoint(velocity_ned=(1.0, 2.0, 0.0), yaw_rate=0.1, frame=mavlink.MAV_FRAME_BODY_NED)
    demand = local_setpoint(message, PX4 if flavour is PX4 else ARDUPILOT, STATE)
    assert demand is not None
    assert demand.velocity == pytest.approx((1.0, -2.0, 0.0))  # forward is east, right is south
    assert demand.yaw_rate == pytest.approx(0.1)


def test_px4_takes_single_axes_ardupilot_all_three_or_none() -> None:
    message = setpoint((0.0, 0.0, -5.0), (1.0, 0.0, 0.0), yaw=0.0)
    message.type_mask |= 0b011  # only the height of the position
    px4, ardupilot = local_setpoint(message, PX4, STATE), local_setpoint(message, ARDUPILOT, STATE)
    assert px4 is not None
    assert ardupilot is not None
    assert px4.position == (None, None, 5.0)
    assert ardupilot.position == (None, None, None)
    assert ardupilot.velocity == (0.0, 1.0, 0.0)


def test_offset_frames_count_from_the_aircraft_on_ardupilot_and_are_refused_by_px4() -> None:
    message = setpoint((1.0, 0.0, -1.0), frame=mavlink.MAV_FRAME_LOCAL_OFFSET_NED)
    demand = local_setpoint(message, ARDUPILOT, STATE)
    assert demand is not None
    assert demand.position == pytest.approx((10.0, 21.0, 31.0))
    assert local_setpoint(message, PX4, STATE) is None


@pytest.mark.parametrize("flavour", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
def test_what_asks_for_nothing_or_for_forces_is_refused(flavour: object) -> None:
    which = PX4 if flavour is PX4 else ARDUPILOT
    assert local_setpoint(setpoint(), which, STATE) is None
    force = setpoint(velocity_ned=(1.0, 0.0, 0.0))
    force.type_mask |= mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET
    assert local_setpoint(force, which, STATE) is None


@pytest.mark.parametrize(("frame", "alt"), [(0, 105.0), (5, 105.0), (3, 5.0), (6, 5.0)])
def test_global_positions_are_above_the_sea_or_above_home(frame: int, alt: float) -> None:
    place = LocalFrame(37.0, 127.0, 100.0, 20.0)
    lat, lon, _ = place.geodetic((30.0, -40.0, 0.0))
    mask = IGNORE_YAW_RATE | 0b111 << 3 | 0b111 << 6
    message = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, mask, round(lat * 1e7), round(lon * 1e7), alt, 0, 0, 0, 0, 0, 0, 1.0, 0
    )
    demand = global_setpoint(message, PX4, place, 100.0)
    assert demand is not None
    assert demand.position == pytest.approx((30.0, -40.0, 5.0), abs=0.02)
    message.type_mask |= IGNORE_POSITION
    assert global_setpoint(message, PX4, place, 100.0) is None


def test_the_local_frame_agrees_with_the_exact_transformation() -> None:
    place = LocalFrame(37.2276, 126.8405, 30.0, 23.0)
    to_enu = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        "+lat_0=37.2276 +lon_0=126.8405 +h_0=53.0"
    )
    for enu in ((10.0, 0.0, 0.0), (50.0, -30.0, 20.0), (-60.0, 80.0, 3.0)):
        lat, lon, alt = place.geodetic(enu)
        exact = to_enu.transform(lon, lat, alt + 23.0)
        assert exact == pytest.approx(enu, abs=2e-3)
        assert place.enu(lat, lon, alt) == pytest.approx(enu, abs=1e-6)
