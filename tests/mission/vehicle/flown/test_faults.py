"""Faults in flight, over the wire: the pilot process, the program, the link, and others who take the aircraft.

The two that speak MAVLink fly each test at the same time; reaction times are measured by a wiretap next to the
aircraft. The AR.Drone goes through its own faults beside them. The series of twenty are in tests/soak.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import pytest

from mission.vehicle.drone import Bounds, Knot, OrderState, Path
from sitl.faults import LinkFaults
from tests.support.ardrone_faults import ArdroneFaults, flown_through_its_faults
from tests.support.fault_bench import HOLD, HOLDS, FaultBench
from tests.support.flown_aircraft import FENCE_M, FINAL, STARVED, Fleet, MavlinkFlown, each

pytestmark = pytest.mark.flight

LOSS = "of the packets, more than 30 %"


@pytest.fixture(scope="module", autouse=True)
def ardrones_series(fleet: Fleet) -> Iterator[Future[ArdroneFaults]]:
    """Flown while the other aircraft have their faults."""
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(flown_through_its_faults, fleet.ardrone)


@pytest.fixture
def ardrone(ardrones_series: Future[ArdroneFaults]) -> ArdroneFaults:
    return ardrones_series.result()


def test_the_local_frame_lies_at_its_origin_above_the_ellipsoid_where_the_geoid_is_known(fleet: Fleet) -> None:
    def check(flown: MavlinkFlown) -> None:
        truth = flown.bench.truth()
        flown.until(lambda: flown.drone.pose_at(truth.t_s) is not None, 2.0)
        pose = flown.drone.pose_at(truth.t_s)
        assert pose is not None
        assert np.abs(pose.position_enu_m[:2] - truth.position_enu_m[:2]).max() < 0.5
        origin = flown.drone.origin
        assert origin is not None
        # PX4's SIH repeats the altitude above the sea as the ellipsoid's: the geoid is unknown there.
        px4 = flown is fleet.px4
        assert origin.datum == ("amsl" if px4 else "ellipsoid")
        assert origin.alt_m == pytest.approx(30.0 if px4 else 53.0, abs=1.0)

    each(fleet.mavlink, check)


def test_a_path_through_the_autopilots_own_geofence_is_refused(fleet: Fleet) -> None:
    far = Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(40.0, (0, FENCE_M + 20.0, 0), (0, 0, 0))))

    def check(flown: MavlinkFlown) -> None:
        flown.drone.begin(Bounds(radius_m=200.0))
        flown.done(flown.drone.hover)
        order = flown.final(flown.drone.fly(far))
        assert order.state is OrderState.REFUSED
        assert f"the autopilot's geofence is at {FENCE_M:.1f} m" in order.reason
        flown.done(flown.drone.hold)

    each(fleet.mavlink, check)


def test_a_geofence_whose_plan_was_read_needs_no_caution(fleet: Fleet) -> None:
    assert not [text for flown in fleet.mavlink for text in flown.cautions if "geofence" in text]


def test_a_killed_pilot_process_leaves_the_aircraft_to_its_own_failsafe(fleet: Fleet) -> None:
    """Leaves the drones without their pilot processes: from here on programs of their own fly."""

    def check(flown: MavlinkFlown) -> None:
        drone, bench = flown.drone, flown.bench
        path = flown.on_its_way()
        assert drone.pilot_pid is not None
        killed_s = time.monotonic()
        os.kill(drone.pilot_pid, signal.SIGKILL)
        events = flown.until(lambda: path.state in FINAL, 5.0)
        assert "pilot-process-lost" in [e.kind for e in events + flown.wait(0.2)]
        assert drone.hover().state is OrderState.REFUSED
        assert not drone.telemetry().connected
        assert bench.comes_to_rest()
        assert bench.tap.setpoints_s(killed_s + 0.1) == []
        drone.close()
        bench.end_failsafe()

    each(fleet.mavlink, check)


def test_a_broken_program_ends_in_hold(fleet: Fleet) -> None:
    """A silent one, too: see the interface's test. A blocked event loop: `make soak`."""

    def check(flown: MavlinkFlown) -> None:
        if flown is fleet.px4:
            assert flown.bench.program_broken("hung", into_s=1.0).hold_ordered_s < 0.7
        else:
            assert flown.bench.program_broken("killed", into_s=1.0).hold_ordered_s < 0.7

    each(fleet.mavlink, check)


def test_the_operators_mode_ends_the_pattern_and_is_never_undone(fleet: Fleet) -> None:
    def check(flown: MavlinkFlown) -> None:
        bench = flown.bench
        hold = HOLD[bench.flavour][-1]
        assert bench.taken_over(lambda: bench.operator_orders_mode(*hold), into_s=1.0) < 1.0
        assert bench.mode() == "hold"

    each(fleet.mavlink, check)


def test_an_operators_fly_here_in_guided_ends_the_pattern(fleet: Fleet) -> None:
    bench = fleet.ardupilot.bench
    bench.fly(into_s=1.0)
    clicked_s = bench.operator_sends_here(15.0)
    # One of our setpoints may replace the order before the autopilot has told of it: then the operator clicks again.
    for _ in range(3):
        if bench.until(lambda: bool(bench.program.said("pilot")), 0.3):
            break
        clicked_s = bench.operator_sends_here(15.0)
    assert "another place" in bench.program.said("pilot")[0]["text"]
    assert not [t for t in bench.tap.setpoints_s(clicked_s) if t - clicked_s > 0.3]
    assert bench.tap.mode_orders(clicked_s) == []
    bench.operator_orders_mode(*HOLD["ardupilot"][-1])


def test_20_percent_packet_loss_is_flown_with_and_40_percent_is_not(fleet: Fleet) -> None:
    def ended_by_loss(bench: FaultBench) -> str:
        """Fly at 20 %, end it by 40 %; why it ended."""
        bench.relay.set(LinkFaults(loss=0.2, duplicate=0.05, reorder=0.05))
        bench.fly(into_s=1.0)
        bench.relay.set(LinkFaults(loss=0.4))
        assert bench.until(lambda: bool(bench.program.said("link-lost")), 6.0)
        return str(bench.program.said("link-lost")[0]["text"])

    def check(flown: MavlinkFlown) -> None:
        bench = flown.bench
        text = ended_by_loss(bench)
        if LOSS not in text:
            # A simulator that stalled on a busy machine sent nothing, which ended the flight first.
            assert any(reason in text for reason in STARVED), text
            assert bench.comes_to_rest()
            bench.end_failsafe()
            text = ended_by_loss(bench)
        assert LOSS in text, text
        # Hold is ordered again only after a heartbeat (1 Hz) has told our mode again: at 40 % that may take seconds.
        assert bench.until(lambda: bench.mode() in HOLDS or bool(bench.program.said("failsafe")), 12.0)
        assert bench.mode() in HOLDS or "did not confirm to hold" in str(bench.program.said("failsafe")[-1]["text"])
        assert bench.comes_to_rest()
        # The share that is lost is known from a hundred packets on, which a stalled simulator does not send at once.
        reason, until_s = "", time.monotonic() + 8.0
        while LOSS not in reason and time.monotonic() < until_s:
            bench.program.forget()
            bench.program.tell("fly 1.8")
            news = bench.program.wait_for("order")
            assert (news["order"], news["state"]) == ("hover", "refused")
            reason = news["reason"]
        assert LOSS in reason, reason

    try:
        each(fleet.mavlink, check)
    finally:
        for flown in fleet.mavlink:
            flown.spoil(False)
            # Where too many setpoints were lost before the program had ordered to hold, the autopilot holds by itself.
            flown.bench.end_failsafe()


def test_a_lost_link_is_reported_and_the_aircraft_stops_by_itself(fleet: Fleet) -> None:
    """The last test that flies: it leaves the autopilots in their failsafe."""

    def check(flown: MavlinkFlown) -> None:
        flown.bench.link_cut(into_s=1.0)

    each(fleet.mavlink, check)


def test_an_ardrone_without_its_pilot_process_hovers(ardrone: ArdroneFaults) -> None:
    assert ardrone.pilot_killed.path.state is OrderState.ENDED
    assert ardrone.pilot_killed.said("pilot-process-lost")
    assert ardrone.pilot_killed.at_rest


def test_on_a_wifi_that_loses_doubles_and_reorders_an_ardrone_completes_or_hovers_with_a_reason(
    ardrone: ArdroneFaults,
) -> None:
    path = ardrone.on_bad_wifi.path
    assert path.state is OrderState.DONE or (path.state is OrderState.ENDED and path.reason)
    assert ardrone.on_bad_wifi.at_rest
    assert 0.15 < ardrone.lost_share < 0.25
    assert ardrone.bad_wifi_pose_rate_hz > 50.0


def test_another_client_that_cuts_an_ardrones_motors_has_it_until_a_new_order_takes_off(ardrone: ArdroneFaults) -> None:
    assert ardrone.motors_cut.path.state is OrderState.ENDED
    assert "Emergency" in ardrone.motors_cut.said("failsafe")
    assert ardrone.motors_cut.at_rest
    assert ardrone.take_off_after_the_cut.state is OrderState.DONE, "the take-off resets the emergency"


def test_another_client_that_lands_an_ardrone_has_it_until_a_new_order_takes_off(ardrone: ArdroneFaults) -> None:
    assert ardrone.landed_by_another.path.state is OrderState.ENDED
    assert "Landing" in ardrone.landed_by_another.path.reason
    assert ardrone.landed_by_another.said("pilot")
    assert ardrone.landed_by_another.at_rest
    assert ardrone.take_off_unasked.state is OrderState.REFUSED, "never without a new order"


def test_an_ardrone_lands_and_flies_nothing_when_it_is_closed(ardrone: ArdroneFaults) -> None:
    assert ardrone.landing.state is OrderState.DONE, ardrone.landing.reason
    assert ardrone.hover_when_closed.state is OrderState.REFUSED
