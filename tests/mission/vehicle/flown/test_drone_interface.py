"""What `Drone` promises, flown by every aircraft that there is, over their wires and at the same time."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Iterator

import numpy as np
import pytest

from mission.errors import LinkError
from mission.pose.buffer import heading
from mission.records import Vector
from mission.vehicle.drone import Drone, Knot, Order, OrderState, Path
from mission.vehicle.make import make_drone
from tests.support.fault_bench import HOLD
from tests.support.flown_aircraft import FINAL, OUT_AND_BACK, Fleet, Flown, MavlinkFlown, each

pytestmark = pytest.mark.flight

TO_THE_SIDE_M = {"px4": 0.35, "ardupilot": 0.35, "ardrone": 0.6}
"""How far the aircraft's true path may lie from the ordered one: the AR.Drone flies by tilt, on its dead reckoning."""


@pytest.fixture(autouse=True)
def hovering(request: pytest.FixtureRequest) -> Iterator[None]:
    """Each aircraft hovers by itself before and after."""
    yield
    if "fleet" in request.fixturenames:
        each(request.getfixturevalue("fleet").all, lambda craft: craft.final(craft.drone.hold()) and None)


@pytest.mark.parametrize("url", ["udpin://127.0.0.1:{port}", "ardrone://127.0.0.1?navdata={port}&at={port}"])
def test_nobody_there_is_a_link_error_in_time(url: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    drone = make_drone(url.format(port=port))
    began = time.monotonic()
    with pytest.raises(LinkError) as caught:
        drone.connect(0.5)
    assert time.monotonic() - began < 15.0, "half a second, and the start of a process"
    assert caught.value.remedy
    drone.close()


def test_it_tells_what_it_is_and_how_it_is(fleet: Fleet) -> None:
    def check(flown: Flown) -> None:
        drone: Drone = flown.drone
        flown.until(lambda: drone.telemetry().pose_rate_hz >= 20.0, 10.0)
        telemetry = drone.telemetry()
        assert drone.name
        assert telemetry.connected
        assert telemetry.in_air
        assert telemetry.battery_fraction is not None
        assert 0.5 < telemetry.battery_fraction <= 1.0
        assert telemetry.height_m == pytest.approx(float(flown.place()[2]), abs=0.4)
        assert flown.place()[2] == pytest.approx(1.6, abs=0.6)
        assert drone.capabilities.global_position == (drone.origin is not None)
        assert drone.noise().position_walk_m_per_sqrt_s > 0.0

    each(fleet.all, check)


def test_hover_stays(fleet: Fleet) -> None:
    def check(flown: Flown) -> None:
        flown.hovers()
        before = flown.place()
        flown.wait(1.0)
        assert np.linalg.norm(flown.place() - before) < 0.3
        assert flown.speed_m_s() < 0.4

    each(fleet.all, check)


def test_turns_to_a_heading_and_then_follows_the_aim(fleet: Fleet) -> None:
    def check(flown: Flown) -> None:
        flown.hovers()
        flown.done(lambda: flown.drone.turn_to(1.0))
        pose = flown.pose_before(0.1)
        assert abs(heading(pose.world_from_body_wxyz) - 1.0) < math.radians(6.0)
        flown.drone.aim(0.7)

        def aimed() -> bool:
            told = flown.drone.telemetry().heading_rad
            return told is not None and abs(math.remainder(told - 0.7, math.tau)) < math.radians(5.0)

        flown.until(aimed, 6.0)

    for flown in fleet.all:
        check(flown)


def test_flies_a_path_with_its_heading_kept_and_reports_where_it_was(fleet: Fleet) -> None:
    # One after another: a gap in the telemetry would be the machine's, not the aircraft's.
    for flown in fleet.all:
        each([flown], _flies_out_and_back)


def _flies_out_and_back(flown: Flown) -> None:
    flown.hovers()
    flown.wait(0.5)
    began = flown.place()
    track: list[tuple[float, Vector]] = []

    def flight() -> Order:
        track.clear()
        order = flown.drone.fly(OUT_AND_BACK)

        def over() -> bool:
            truth = flown.truth()
            track.append((truth.t_s, np.array(truth.position_enu_m)))
            return order.state in FINAL

        flown.until(over, 15.0)
        return order

    order = flown.done(flight)
    assert order.started_s is not None
    true = np.array([place - began for _, place in track])
    assert true[:, 0].max() == pytest.approx(1.2, abs=TO_THE_SIDE_M[flown.kind])
    assert np.abs(true[:, 1:]).max() < TO_THE_SIDE_M[flown.kind]
    assert np.linalg.norm(true[-1]) < TO_THE_SIDE_M[flown.kind]
    # What it says of itself agrees with the truth over the pattern, as far as its own noise model promises (4 sigmas).
    poses = [(place, flown.drone.pose_at(t_s)) for t_s, place in track if t_s < track[-1][0] - 0.3]
    told = [pose for _, pose in poses if pose is not None]
    truth = np.array([place for place, pose in poses if pose is not None])
    assert len(told) > 0.7 * len(poses), "the rest fell into gaps: the simulator stalls on a busy machine"
    where = np.array([pose.position_enu_m for pose in told])
    noise = flown.drone.noise()
    drift = 4.0 * math.hypot(noise.position_sigma_m, noise.position_walk_m_per_sqrt_s * math.sqrt(5.0))
    assert np.linalg.norm((where - where[0]) - (truth - truth[0]), axis=1).max() < max(0.25, drift)
    headings = np.degrees([heading(pose.world_from_body_wxyz) for pose in told])
    assert np.abs(headings - headings[0]).max() < 6.0


def test_a_path_beyond_the_bounds_is_refused(fleet: Fleet) -> None:
    far = Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(30.0, (30.0, 0, 0), (0, 0, 0))))

    def check(flown: Flown) -> None:
        flown.hovers()
        order = flown.final(flown.drone.fly(far))
        assert order.state is OrderState.REFUSED
        assert "bounds" in order.reason
        nonsense = flown.final(flown.drone.turn_to(math.nan))
        assert nonsense.state is OrderState.REFUSED

    each(fleet.all, check)


def test_a_pose_is_only_given_where_there_is_one(fleet: Fleet) -> None:
    for flown in fleet.all:
        now = time.monotonic()
        assert flown.drone.pose_at(now + 1.0) is None
        assert flown.drone.pose_at(now - 3600.0) is None
        pose = flown.pose_before(0.2)
        assert now - 0.2 <= pose.t_s <= time.monotonic() - 0.2
        assert np.linalg.eigvalsh(pose.position_covariance_m2).min() > 0.0
        assert np.linalg.eigvalsh(pose.attitude_covariance_rad2).min() > 0.0


def test_a_silent_program_stops_it(fleet: Fleet) -> None:
    def check(flown: Flown) -> None:
        order = flown.on_its_way()
        silent_s = time.monotonic()
        time.sleep(1.0)  # the silence that is tested
        events = flown.until(lambda: order.state in FINAL, 5.0)
        assert order.state is OrderState.ENDED
        assert any(event.kind == "deadman" for event in events)
        assert flown.comes_to_rest()
        if isinstance(flown, MavlinkFlown):
            ordered = [
                t for t, *mode in flown.bench.tap.mode_orders(silent_s) if tuple(mode) in HOLD[flown.bench.flavour]
            ]
            assert ordered[0] - silent_s < 0.7
        refused = flown.final(flown.drone.hover())
        assert refused.state is OrderState.REFUSED, "control is not taken twice on one permission"

    each(fleet.all, check)


def test_hold_gives_control_back(fleet: Fleet) -> None:
    def check(flown: Flown) -> None:
        flown.hovers()
        flown.done(flown.drone.hold)
        order = flown.final(flown.drone.hover())
        assert order.state is OrderState.REFUSED
        flown.hovers()

    each(fleet.all, check)
