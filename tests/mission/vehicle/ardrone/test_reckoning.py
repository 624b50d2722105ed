"""Dead reckoning: velocity and heading make a place, gaps and disorder make doubt, GPS makes it a place on earth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
import pytest

from mission.geodesy import enu_to_geodetic
from mission.pose.buffer import heading
from mission.records import GeodeticOrigin
from mission.vehicle.ardrone.navdata import Navdata
from mission.vehicle.ardrone.navdata_options import Control, Demo, DroneTime, Gps, Magneto
from mission.vehicle.ardrone.pose_quality import noise_model, position_covariance
from mission.vehicle.ardrone.reckoning import Reckoned, Reckoning

STEP_S = 0.005
HOME = GeodeticOrigin(48.5, 2.25, 120.0, "amsl")


def demo(forward: float = 0.0, right: float = 0.0, yaw: float = 0.0, altitude: float = 1.5) -> Demo:
    return Demo(Control.FLYING, 0, 0.9, 0.02, -0.03, yaw, altitude, (forward, right, 0.0))


def gps(lat_deg: float, lon_deg: float, frame_ms: int, hdop: float = 1.0) -> Gps:
    return Gps(lat_deg, lon_deg, 121.5, hdop, True, 1, 8, True, frame_ms)


def fly(
    reckoning: Reckoning,
    count: int,
    of: Callable[[int], Demo],
    *,
    first: int = 1,
    start_s: float = 5.0,
    only: Iterable[int] | None = None,
    magneto: Magneto | None = None,
) -> list[Reckoned]:
    """Packets at 200 Hz, `of(k)` each; only those numbers, in that order, when given."""
    found = []
    for k in range(count) if only is None else only:
        time = DroneTime((start_s + k * STEP_S) % DroneTime.WRAP_S)
        reckoned = reckoning.add(Navdata(1, first + k, of(k), time, magneto=magneto), 1000.0 + k * STEP_S)
        found += [] if reckoned is None else [reckoned]
    return found


def test_sideways_at_a_heading() -> None:
    yaw = math.radians(30.0)
    last = fly(Reckoning(), 401, lambda _: demo(right=-1.5, yaw=yaw))[-1]
    assert last.position_enu_m == pytest.approx([-3.0 * math.cos(yaw), 3.0 * math.sin(yaw), 1.5], abs=1e-6)
    assert last.velocity_enu_m_s == pytest.approx([-1.5 * math.cos(yaw), 1.5 * math.sin(yaw), 0.0], abs=1e-6)
    assert heading(last.world_from_body_wxyz) == pytest.approx(yaw)


def test_a_calibrated_scale_corrects_the_travel() -> None:
    last = fly(Reckoning(velocity_scale=0.9), 401, lambda _: demo(forward=1.0))[-1]
    assert last.position_enu_m[:2] == pytest.approx([0.0, 1.8])


def test_a_full_circle_ends_where_it_began() -> None:
    turn = math.tau / 800
    last = fly(Reckoning(), 801, lambda k: demo(forward=1.0, yaw=k * turn))[-1]
    assert np.linalg.norm(last.position_enu_m[:2]) < 1e-3


def test_the_height_follows_without_lag_and_gives_the_climb() -> None:
    found = fly(Reckoning(), 600, lambda k: demo(altitude=1.0 + 0.4 * k * STEP_S))
    assert found[-1].position_enu_m[2] == pytest.approx(1.0 + 0.4 * 599 * STEP_S, abs=1e-3)
    assert found[-1].velocity_enu_m_s[2] == pytest.approx(0.4, abs=1e-3)


def test_doubles_and_late_packets_change_nothing() -> None:
    order = [0, 1, 1, 2, 4, 3, 5, 5, 2, 6]
    mixed = fly(Reckoning(), 0, lambda _: demo(forward=1.0), only=order)
    assert [round((r.drone_s - 5.0) / STEP_S) for r in mixed] == [0, 1, 2, 4, 5, 6]
    assert mixed[-1].position_enu_m[1] == pytest.approx(6 * STEP_S)


def test_lost_packets_cost_no_distance() -> None:
    kept = [k for k in range(401) if k % 5 != 3]
    assert fly(Reckoning(), 0, lambda _: demo(forward=1.0), only=kept)[-1].position_enu_m[1] == pytest.approx(2.0)


def test_a_gap_is_bridged_and_its_doubt_is_told() -> None:
    whole, gappy = Reckoning(), Reckoning()
    fly(whole, 401, lambda _: demo(forward=1.0))
    found = fly(gappy, 0, lambda _: demo(forward=1.0), only=[*range(100), *range(300, 401)])
    assert found[-1].position_enu_m[1] == pytest.approx(2.0)
    assert gappy.variance_m2 > whole.variance_m2 + 0.2


def test_the_clock_may_wrap() -> None:
    found = fly(Reckoning(), 401, lambda _: demo(forward=1.0), start_s=DroneTime.WRAP_S - 1.0)
    assert found[-1].drone_s - found[0].drone_s == pytest.approx(2.0)
    assert found[-1].position_enu_m[1] == pytest.approx(2.0)
    assert not any(r.restarted for r in found)


def test_a_restarted_drone_begins_anew_where_it_was() -> None:
    reckoning = Reckoning()
    before = fly(reckoning, 400, lambda _: demo(forward=1.0), first=5000)[-1]
    after = fly(reckoning, 3, lambda _: demo(), first=1, start_s=0.1)
    assert [r.restarted for r in after] == [True, False, False]
    assert after[-1].position_enu_m[:2] == pytest.approx(before.position_enu_m[:2])
    assert reckoning.variance_m2 > 0.9


def test_a_clock_that_begins_to_be_told_does_not_stop_the_reckoning() -> None:
    reckoning = Reckoning()
    for k in range(20):  # demo mode: no time option
        assert reckoning.add(Navdata(1, 1 + k, demo()), 1000.0 + k * 0.066) is not None
    found = fly(reckoning, 200, lambda _: demo(forward=1.0), first=100)
    assert len(found) == 200
    assert found[0].restarted


def test_without_gps_the_answer_stays_local_and_the_drift_grows() -> None:
    reckoning = Reckoning()
    fly(reckoning, 200, lambda _: demo())
    early = position_covariance(reckoning)[0, 0]
    fly(reckoning, 800, lambda _: demo(), first=201, start_s=6.0)
    assert reckoning.origin is None
    assert position_covariance(reckoning)[0, 0] == pytest.approx(5.0 * early, rel=0.05)
    assert noise_model(reckoning, declination_known=False).position_walk_m_per_sqrt_s == 0.1


def test_the_magnetometer_gives_north_and_the_declination_makes_it_true() -> None:
    magneto = Magneto(math.radians(400.0), calibrated=True)
    last = fly(Reckoning(math.radians(5.0)), 50, lambda _: demo(yaw=math.radians(10.0)), magneto=magneto)[-1]
    assert last.yaw_rad == pytest.approx(math.radians(45.0))
    unsure = Magneto(math.radians(400.0), calibrated=False)
    last = fly(Reckoning(math.radians(5.0)), 50, lambda _: demo(yaw=math.radians(10.0)), magneto=unsure)[-1]
    assert last.yaw_rad == pytest.approx(math.radians(10.0))


def test_a_fix_places_the_local_frame_and_later_ones_only_pull_slowly() -> None:
    reckoning = Reckoning()
    fly(reckoning, 201, lambda _: demo(forward=2.0))  # 2 m north of the local zero
    here = enu_to_geodetic(np.array([0.0, 2.0, 0.0]), HOME)
    reckoning.add(Navdata(1, 300, demo(), DroneTime(6.1), gps=gps(here.lat_deg, here.lon_deg, 1)), 1001.1)
    origin = reckoning.origin
    assert origin is not None
    assert origin.datum == "amsl"
    assert (origin.lat_deg, origin.lon_deg) == pytest.approx((48.5, 2.25), abs=2e-6)
    assert origin.alt_m == pytest.approx(120.0, abs=0.01)
    there = enu_to_geodetic(np.array([5.0, 2.0, 0.0]), HOME)
    moved = []
    for k in range(50):  # ten seconds of fixes 5 m to the east
        fix = gps(there.lat_deg, there.lon_deg, 2 + k)
        reckoned = reckoning.add(Navdata(1, 301 + k, demo(), DroneTime(6.3 + 0.2 * k), gps=fix), 1001.3 + 0.2 * k)
        assert reckoned is not None
        moved.append(float(reckoned.position_enu_m[0]))
    assert max(np.diff(moved)) < 0.05, "no jump that a pattern would take for motion"
    assert 0.5 < moved[-1] < 4.0
    assert noise_model(reckoning, declination_known=False).heading_bias_sigma_rad == pytest.approx(0.035)


def test_a_compass_heading_of_unknown_declination_is_worse() -> None:
    reckoning = Reckoning()
    magneto = Magneto(0.2, calibrated=True)
    reckoning.add(Navdata(1, 1, demo(), DroneTime(5.0), magneto=magneto, gps=gps(48.5, 2.25, 1)), 1000.0)
    known = noise_model(reckoning, declination_known=True).heading_bias_sigma_rad
    unknown = noise_model(reckoning, declination_known=False).heading_bias_sigma_rad
    assert math.radians(4.0) < known < unknown < math.radians(12.0)


def test_without_a_place_on_earth_the_compass_still_errs() -> None:
    reckoning = Reckoning()
    fly(reckoning, 10, lambda _: demo())
    assert noise_model(reckoning, declination_known=False).world_heading_sigma_rad == 0.0
    fly(reckoning, 10, lambda _: demo(), first=11, start_s=5.1, magneto=Magneto(0.2, calibrated=True))
    noise = noise_model(reckoning, declination_known=False)
    assert noise.world_heading_sigma_rad == pytest.approx(math.radians(5.0)), "the reckoned path turns with it"
    assert noise.position_scale_sigma > 0.0


@pytest.mark.parametrize(
    "wrong",
    [
        Gps(0.0, 0.0, 0.0, 1.0, True, 1, 8, True, 1),
        Gps(48.5, 2.25, 0.0, 1.0, True, 0, 8, True, 1),
        Gps(48.5, 2.25, 0.0, 0.0, True, 1, 8, True, 1),
        Gps(91.0, 2.25, 0.0, 1.0, True, 1, 8, True, 1),
        Gps(48.5, 2.25, 0.0, 1.0, True, 1, 8, False, 1),
    ],
)
def test_what_is_no_fix_places_nothing(wrong: Gps) -> None:
    reckoning = Reckoning()
    reckoning.add(Navdata(1, 1, demo(), DroneTime(5.0), gps=wrong), 1000.0)
    assert reckoning.origin is None
