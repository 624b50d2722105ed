"""The simulated flights against the recorded ones and the figures measured on real builds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sitl.autopilot.airframe import Wind
from sitl.autopilot.config import AutopilotConfig, FlavourName
from sitl.autopilot.estimate_errors import NoiseName
from tests.support.autopilot_bench import Bench, setpoint, velocity_step


def lateral_track(flavour: FlavourName, noise: NoiseName, seed: int) -> tuple[float, float, float, float, float]:
    """2 m/s for 5 s: mean speed over 3 to 5 s, distance at 5 s, overrun, cross-track and height range, all true."""
    bench = Bench(AutopilotConfig(flavour=flavour, noise=noise, seed=seed, parameters=_KEEP[flavour]))
    bench.hover()
    stream = velocity_step(2.0, 5.0)
    stay = velocity_step(0.0, 0.0)
    bench.enter_offboard(stay)
    bench.run(1.0, stay)
    bench.path()
    bench.run(8.0, stream)
    track = bench.path()
    t = track[:, 0] - track[0, 0]
    east, moving = track[:, 1] - track[0, 1], (t > 3.0) & (t < 5.0)
    at_5 = float(np.interp(5.0, t, east))
    return (
        float(track[moving, 4].mean()),
        at_5,
        float(east.max() - at_5),
        float(np.ptp(track[:, 2])),
        float(np.ptp(track[:, 3])),
    )


_KEEP: dict[FlavourName, tuple[tuple[str, float], ...]] = {"px4": (("COM_OBL_RC_ACT", 5),), "ardupilot": ()}


def test_a_velocity_step_on_ardupilot_goes_as_far_as_on_the_real_one() -> None:
    speed, distance, overrun, cross, height = lateral_track("ardupilot", "good", 1)
    assert speed == pytest.approx(1.99, abs=0.1)
    assert distance == pytest.approx(8.4, abs=0.3)
    assert overrun == pytest.approx(1.75, abs=0.25)
    assert 0.01 < cross < 0.3
    assert height < 0.2


def test_px4_never_reaches_the_speed_that_is_asked_for() -> None:
    speed, distance, overrun, cross, height = lateral_track("px4", "good", 1)
    assert 1.5 < speed < 1.78
    assert 6.3 < distance < 7.3
    assert 1.4 < overrun < 2.1
    assert cross < 0.5
    assert height < 0.25


def test_px4_with_stock_noise_strays_further() -> None:
    runs = np.array([lateral_track("px4", "rough", seed) for seed in (1, 2, 3)])
    assert 6.0 < np.median(runs[:, 1]) < 7.5
    assert 0.2 < np.median(runs[:, 3]) < 1.6
    assert 0.08 < np.median(runs[:, 4]) < 0.6


def out_and_back(t: float) -> tuple[float, float]:
    """Distance and speed of 3 m out and back in 6 s, raised cosines: the recorded flights' order."""
    if t >= 6.0:
        return 0.0, 0.0
    phase, way = math.pi * (t % 3.0) / 3.0, 1.0 if t < 3.0 else -1.0
    start = 0.0 if t < 3.0 else 3.0
    return start + way * 1.5 * (1 - math.cos(phase)), way * 0.5 * math.pi * math.sin(phase)


def test_ardupilot_overshoots_a_position_and_velocity_path_as_in_the_recorded_flight(ardupilot: Bench) -> None:
    ardupilot.hover()
    state = ardupilot.autopilot.vehicle.estimate.position

    def stream(t: float) -> object:
        d, v = out_and_back(t)
        return setpoint((state[1], state[0] - d, -state[2]), (0.0, -v, 0.0), yaw=0.0)

    ardupilot.enter_offboard(lambda _: stream(99.0))
    ardupilot.run(1.0, lambda _: stream(99.0))
    ardupilot.path()
    ardupilot.run(9.0, stream)
    east = ardupilot.path()[:, 1]
    assert -3.9 < east.min() - east[0] < -3.2  # 3.65 recorded
    assert 0.3 < east.max() - east[0] < 1.1  # 0.99 recorded
    assert abs(east[-1] - east[0]) < 0.3


def test_take_off_takes_the_time_and_reaches_the_height_of_the_real_ones(flavour: FlavourName) -> None:
    bench = Bench(AutopilotConfig(flavour=flavour, seed=2))
    bench.fly_up(3.0, seconds=3.0 if flavour == "px4" else 1.5)
    assert bench.height() < 0.3  # the motors come up slowly
    bench.run(6.0 if flavour == "px4" else 4.5)
    assert bench.height() == pytest.approx(3.0, abs=0.25)


def heading_change(flavour: FlavourName, seed: int, absolute: bool) -> float:
    bench = Bench(AutopilotConfig(flavour=flavour, seed=seed))
    bench.hover()
    start = bench.heading_deg()
    yaw = {"yaw": math.radians(start)} if absolute else {"yaw_rate": 0.0}

    def stream(t: float) -> object:
        return setpoint(velocity_ned=(0.0, 2.0, 0.0), frame=1 if absolute else 8, **yaw)  # type: ignore[arg-type]

    bench.enter_offboard(stream)
    bench.run(0.5, stream)
    start = bench.heading_deg()
    bench.run(4.0, stream)
    return abs(bench.heading_deg() - start)


def test_a_yaw_rate_of_zero_holds_the_heading_on_ardupilot_only() -> None:
    assert heading_change("ardupilot", 3, absolute=False) < 1.5
    drifts = [heading_change("px4", seed, absolute=False) for seed in (1, 2)]
    assert max(drifts) > 2.0
    assert max(drifts) < 15.0


def test_an_absolute_yaw_holds_the_heading(flavour: FlavourName) -> None:
    assert heading_change(flavour, 1, absolute=True) < 1.5


def test_no_yaw_at_all_turns_the_nose_into_the_track_on_ardupilot(ardupilot: Bench) -> None:
    ardupilot.hover()
    ardupilot.enter_offboard(lambda _: setpoint(velocity_ned=(0.0, 2.0, 0.0)))
    ardupilot.run(6.0, lambda _: setpoint(velocity_ned=(0.0, 2.0, 0.0)))
    assert ardupilot.heading_deg() == pytest.approx(90.0, abs=6.0)


def test_wind_is_held_against_and_gusts_move_the_aircraft() -> None:
    spread = []
    for gust in (0.0, 1.5):
        config = AutopilotConfig(flavour="ardupilot", noise="none", wind=Wind((3.0, 0.0, 0.0), gust))
        bench = Bench(config)
        bench.hover()
        bench.run(3.0)
        bench.path()
        bench.run(4.0)
        track = bench.path()
        assert np.ptp(track[:, 1]) < 1.0
        assert abs(bench.autopilot.vehicle.euler[0]) > math.radians(1.0)  # it leans into the wind
        spread.append(float(np.std(track[:, 1])))
    assert spread[1] > 2.0 * spread[0]


def test_a_px4_with_simple_sensors_strays_from_its_hover_while_it_turns_as_a_real_one_does() -> None:
    """Up to 0.8 m at 0.3 to 0.6 m/s was seen of a real one; without turning it stays nearer."""
    fastest = []
    for seed, rate in ((2, 0.15), (2, 0.0)):
        bench = Bench(AutopilotConfig(flavour="px4", noise="rough", seed=seed))
        bench.hover()
        east, north, _ = bench.autopilot.vehicle.estimate.position

        def stream(t: float, place: tuple[float, float, float] = (north, east, -3.0), rate: float = rate) -> Any:
            return setpoint(position_ned=place, yaw=rate * t)

        bench.enter_offboard(stream)
        bench.path()
        bench.run(8.0, stream)
        path = bench.path()
        fastest.append(float(np.hypot(path[:, 4], path[:, 5]).max()))
    assert 0.3 < fastest[0] < 0.8
    assert fastest[1] < fastest[0]
