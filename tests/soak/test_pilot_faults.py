"""Issue-sized series of faults in flight: twenty patterns each, measured on the wire next to the aircraft."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator

import numpy as np
import pytest

from sitl.autopilot.config import FlavourName
from tests.soak.conftest import Note
from tests.support.fault_bench import HOLD, Fault, FaultBench, fault_bench

pytestmark = [pytest.mark.soak, pytest.mark.timeout(1800)]

RUNS = 20
WATCH_S = 3.0
MODES: dict[FlavourName, tuple[tuple[int, int], ...]] = {
    "px4": ((4, 3), (4, 5), (4, 6)),
    "ardupilot": ((5, 0), (17, 0), (6, 0), (9, 0), (16, 0)),
}
"""Main and sub mode: hold, return, land, and what else holds still."""


@pytest.fixture(scope="module", params=["px4", "ardupilot"])
def bench(request: pytest.FixtureRequest) -> Iterator[FaultBench]:
    with fault_bench(request.param, height_m=6.0) as found:
        found.take_off()
        yield found


def _moments(seed: int) -> list[float]:
    """Random times within the six seconds of the pattern."""
    return [float(t) for t in np.random.default_rng(seed).uniform(0.2, 5.5, RUNS)]


@pytest.mark.parametrize("fault", ["hung", "killed", "silent", "blocked"])
def test_a_broken_program_ends_in_hold_within_half_a_second(bench: FaultBench, fault: Fault, note: Note) -> None:
    reactions = [bench.program_broken(fault, moment) for moment in _moments(1)]
    ordered = [r.hold_ordered_s for r in reactions]
    note(f"{bench.flavour}: program {fault}, until hold is ordered (s)", ordered)
    note(f"{bench.flavour}: program {fault}, last setpoint (s)", [r.last_setpoint_s for r in reactions])
    assert np.median(ordered) <= 0.5
    assert max(ordered) <= 0.7


def test_a_killed_pilot_process_leaves_an_aircraft_that_holds(bench: FaultBench, note: Note) -> None:
    rested = []
    for moment in _moments(2):
        rested.append(bench.pilot_killed(moment))
        bench.end_failsafe()
    note(f"{bench.flavour}: pilot process killed, until it hovers (s)", rested)
    assert len(rested) == RUNS


def test_a_pilot_process_that_hangs_ends_itself_and_the_aircraft_holds(bench: FaultBench, note: Note) -> None:
    ordered, ended = [], []
    for i, moment in enumerate(_moments(6)):
        if i % 2 == 0:
            ordered.append(bench.pilot_hung(moment, signal.SIGUSR1).hold_ordered_s)
        else:
            ended.append(bench.pilot_hung(moment, signal.SIGUSR2).last_setpoint_s)
        bench.end_failsafe()
    note(f"{bench.flavour}: pilot process's loop hung, until hold is ordered (s)", ordered)
    note(f"{bench.flavour}: pilot process's Python hung, last setpoint (s)", ended)
    assert max(ordered) <= 0.9
    assert max(ended) <= 2.5


def test_a_lost_link_leaves_an_aircraft_that_holds(bench: FaultBench, note: Note) -> None:
    rested = []
    for moment in _moments(3):
        rested.append(bench.link_cut(moment))
        bench.end_failsafe()
    note(f"{bench.flavour}: link lost, until it hovers (s)", rested)


def test_the_operators_mode_silences_us_within_a_second_and_stays(bench: FaultBench, note: Note) -> None:
    silent = []
    for i, moment in enumerate(_moments(4)):
        mode = MODES[bench.flavour][i % len(MODES[bench.flavour])]
        silent.append(bench.taken_over(lambda: bench.operator_orders_mode(*mode), moment, WATCH_S))  # noqa: B023
        bench.operator_orders_mode(*HOLD[bench.flavour][-1])
        time.sleep(0.5)
    note(f"{bench.flavour}: the operator's mode, last setpoint after it (s)", silent)
    assert max(silent) <= 1.0


def test_fly_here_in_guided_silences_us_at_the_first_or_second_click(bench: FaultBench, note: Note) -> None:
    if bench.flavour != "ardupilot":
        pytest.skip("PX4 leaves Offboard for Hold: a mode change")
    clicks, silent = [], []
    for moment in _moments(5):
        bench.fly(moment)
        first_s = bench.operator_sends_here(15.0)
        clicked = 1
        while not bench.until(lambda: bool(bench.program.said("pilot")), 0.3):
            bench.operator_sends_here(15.0)
            clicked += 1
            assert clicked < 5, "fly here is not noticed"
        bench.operator_sends_here(15.0)
        time.sleep(1.0)
        assert bench.truth().velocity_enu_m_s[1] > 0.5, "it flies where the operator sent it"
        setpoints = bench.tap.setpoints_s(first_s)
        silent.append((setpoints[-1] if setpoints else first_s) - first_s)
        clicks.append(clicked)
        assert bench.tap.mode_orders(first_s) == []
        bench.operator_orders_mode(5, 0)
        time.sleep(0.5)
    note("ardupilot: fly here, clicks until it is noticed", [float(n) for n in clicks])
    note("ardupilot: fly here, last setpoint after the first click (s)", silent)
    assert clicks.count(1) >= 0.7 * RUNS
    assert max(silent) <= 1.0
