"""Lost answers to our mode orders and a pilot who chooses his mode right after them, with the real pilot process.

All the other orders, and far more cases, are in tests/mission/vehicle/pilot/test_lost_answers.py in simulated time.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.framing import frames
from sitl.autopilot.config import FlavourName
from sitl.faults import Towards
from tests.soak.conftest import Note
from tests.support.fault_bench import HOLD, NOT_YET, OFFBOARD, FaultBench, fault_bench

pytestmark = [pytest.mark.soak, pytest.mark.timeout(1800)]

ALL = 1_000_000
LOST = (1, 2, ALL)
RUNS = 17
"""For each of the orders, lost answers and autopilots: 204 flights."""
WATCH_S = 1.6
_LOW_M = 4.0
MODES: dict[FlavourName, tuple[tuple[int, int], ...]] = {
    "px4": ((4, 3), (4, 3), (4, 5)),
    "ardupilot": ((5, 0), (16, 0), (6, 0)),
}
"""Main and sub mode of the pilot: the one that it was in before, and others."""
NAMES = {(4, 3): "hold", (4, 5): "rtl", (5, 0): "hold", (16, 0): "position", (6, 0): "rtl"}


@pytest.fixture(scope="module", params=["px4", "ardupilot"])
def bench(request: pytest.FixtureRequest) -> Iterator[FaultBench]:
    with fault_bench(request.param, height_m=6.0) as found:
        found.take_off()
        yield found


class LosesAnswers:
    """Drops the first answers to mode orders."""

    def __init__(self, count: int) -> None:
        self.left = count

    def __call__(self, towards: Towards, data: bytes) -> bool:
        if towards != "program" or self.left <= 0:
            return False
        for message_id, frame in frames(data):
            command = int.from_bytes(frame[10:12], "little")
            if message_id == mavlink.MAVLINK_MSG_ID_COMMAND_ACK and command == mavlink.MAV_CMD_DO_SET_MODE:
                self.left -= 1
                return True
        return False


def _ordered_s(bench: FaultBench, mode: tuple[int, int], act: Callable[[], None]) -> float:
    """When the aircraft received our order of a mode."""
    deadline = time.monotonic() + 5.0
    while time.monotonic() < deadline:
        act()
        found = [t_s for t_s, *ordered in bench.tap.mode_orders() if tuple(ordered) == mode]
        if found:
            return found[0]
        time.sleep(0.002)  # looks again until the deadline
    raise AssertionError(f"{mode} is not ordered; {bench.program.past[-4:]}")


def _one(bench: FaultBench, order: str, lost: int, delay_s: float, mode: tuple[int, int]) -> None:
    home = HOLD[bench.flavour][-1]
    bench.operator_orders_mode(*home)
    assert bench.until(lambda: bench.mode() == "hold", 3.0)
    time.sleep(0.3)  # the program has seen the operator's mode
    while bench.truth().position_enu_m[2] < _LOW_M:  # the pilot's modes bring it down
        bench.fly(0.0)
        assert bench.program.wait_for("order")["state"] == "done"
        bench.operator_orders_mode(*home)
        time.sleep(0.3)  # the program has seen the operator's mode
    program = bench.program
    program.forget()
    asked_s = 0.0

    def fly() -> None:
        nonlocal asked_s
        refused = any(any(r in str(n.get("reason")) for r in NOT_YET) for n in program.past)
        if not asked_s or (refused and time.monotonic() - asked_s > 0.3):
            program.forget()
            program.tell("fly 1.8")
            asked_s = time.monotonic()
        program.said("")

    bench.tap.clear()
    if order == "entry":
        bench.relay.drop_when(LosesAnswers(lost))
        sent_s = _ordered_s(bench, OFFBOARD[bench.flavour], fly)
    else:
        _ordered_s(bench, OFFBOARD[bench.flavour], fly)
        program.wait_for("flying_s")
        time.sleep(0.5)  # into the pattern
        bench.tap.clear()
        bench.relay.drop_when(LosesAnswers(lost))
        program.tell("hold")
        sent_s = _ordered_s(bench, HOLD[bench.flavour][0], lambda: None)
    time.sleep(max(0.0, sent_s + delay_s - time.monotonic()))
    acted_s = bench.operator_orders_mode(*mode)
    time.sleep(WATCH_S)
    said = f"{order}, {lost} answers lost, {mode} after {delay_s:.2f} s"
    # What set out while the pilot's order was on its way is on its way, too: nothing else may follow.
    assert bench.tap.mode_orders(acted_s + 0.02) == [], said
    assert bench.mode() == NAMES[mode], said
    assert not program.said("pilot-process-lost"), said
    bench.relay.drop_when(LosesAnswers(0))


@pytest.mark.parametrize("order", ["entry", "hold"])
def test_the_pilots_mode_is_never_changed_by_us(bench: FaultBench, order: str, note: Note) -> None:
    moments = np.random.default_rng(9).uniform(0.0, 1.0, RUNS)
    flown = 0
    for (lost, delay_s), mode in zip(
        itertools.product(LOST, moments), itertools.cycle(MODES[bench.flavour]), strict=False
    ):
        _one(bench, order, lost, float(delay_s), mode)
        flown += 1
    note(f"{bench.flavour}: {order}, flights with lost answers and the pilot's mode kept", [float(flown)])
