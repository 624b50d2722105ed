from __future__ import annotations

import numpy as np
import pytest

from mission.clock import ClockMap
from tests.support.tlog import ARDUCOPTER, PX4, messages


def _run(clock: ClockMap, offset_s: float, drift: float, delays_s: np.ndarray, rate_hz: float = 50.0) -> list[float]:
    """Feeds messages and returns, for each, to_local(remote) minus the true program time of its sending."""
    errors = []
    for i, delay in enumerate(delays_s):
        local = 1000.0 + i / rate_hz
        remote = (local - offset_s) / (1.0 + drift)
        clock.observe(remote, local + float(delay))
        errors.append(clock.to_local(remote) - local)
    return errors


def test_queueing_delay_does_not_move_the_map() -> None:
    rng = np.random.default_rng(1)
    errors = _run(ClockMap(), 980.0, 0.0, 0.004 + rng.exponential(0.02, 3000))
    assert max(abs(e - 0.004) for e in errors[50:]) < 0.004


def test_a_burst_held_back_for_two_seconds_does_not_move_the_map() -> None:
    delays = np.full(2000, 0.003)
    delays[1000:1100] = np.linspace(2.0, 0.02, 100)
    errors = _run(ClockMap(), -55.0, 0.0, delays)
    assert max(abs(e - 0.003) for e in errors) < 1e-3


@pytest.mark.parametrize("drift", [-0.02, -1e-4, 5e-5, 0.012, 0.02])
def test_a_drifting_remote_clock_is_followed(drift: float) -> None:
    rng = np.random.default_rng(2)
    errors = _run(ClockMap(), 900.0, drift, 0.001 + rng.exponential(0.003, 3000))
    assert max(abs(e) for e in errors[500:]) < 0.008


def test_a_restarted_remote_clock_is_picked_up_at_once() -> None:
    clock = ClockMap()
    _run(clock, 900.0, 0.0, np.full(500, 0.002))
    clock.observe(0.5, 1020.0)
    assert clock.to_local(0.5) == pytest.approx(1020.0)


def test_a_remote_clock_that_stood_still_is_followed_again_within_five_seconds() -> None:
    clock = ClockMap()
    _run(clock, 900.0, 0.0, np.full(1000, 0.002))
    for i in range(300):
        clock.observe(120.0 + i / 50.0, 1030.0 + i / 50.0)
    assert clock.to_local(125.98) == pytest.approx(1035.98, abs=0.01)


def test_a_single_absurd_remote_time_does_no_lasting_harm() -> None:
    clock = ClockMap()
    _run(clock, 900.0, 0.0, np.full(500, 0.002))
    clock.observe(4e6, 1010.0)
    clock.observe(110.02, 1010.022)
    assert clock.to_local(110.02) == pytest.approx(1010.02, abs=0.01)


def test_to_remote_is_the_inverse() -> None:
    clock = ClockMap()
    _run(clock, 900.0, 0.01, np.full(1000, 0.002))
    assert clock.to_remote(clock.to_local(117.3)) == pytest.approx(117.3, abs=1e-9)


def test_it_says_when_it_knows_nothing() -> None:
    clock = ClockMap()
    assert not clock.ready
    with pytest.raises(ValueError, match="no message"):
        clock.to_local(1.0)


@pytest.mark.parametrize("path", [ARDUCOPTER, PX4], ids=["ardupilot", "px4"])
def test_real_boot_times_are_mapped_to_their_arrival(path: object) -> None:
    # The PX4 log's own clock ran 1.2 % slow (simulation on a busy machine); the ArduPilot one kept time.
    clock, late = ClockMap(), []
    for arrived, message in messages(path):  # type: ignore[arg-type]
        if message.get_type() == "ATTITUDE":
            clock.observe(message.time_boot_ms * 1e-3, arrived)
            late.append(arrived - clock.to_local(message.time_boot_ms * 1e-3))
    settled = np.array(late[500:])
    assert settled.min() > -1e-6
    assert np.median(settled) < 0.02
    assert np.percentile(settled, 99) < 0.06
