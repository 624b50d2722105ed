from __future__ import annotations

import os
import signal
import stat
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.errors import LinkError, SettingsError
from sitl.aircraft.truth import TruthRing
from sitl.autopilot.config import AutopilotConfig, FlavourName
from sitl.autopilot.local_frame import LocalFrame
from sitl.simulation.external import start_external, true_state

PLACE = LocalFrame(37.2276, 126.8405, 30.0, 23.0)


@pytest.fixture
def ring() -> Iterator[TruthRing]:
    made = TruthRing.create(seconds=20.0, rate_hz=50.0)
    yield made
    made.close()
    made.unlink()


def executable(folder: Path, script: str) -> Path:
    path = folder / "autopilot"
    path.write_text(f"#!{sys.executable}\n{script}")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@pytest.fixture
def speaking(tmp_path: Path) -> Path:
    return executable(tmp_path, (Path(__file__).parent / "fake_sitl.py").read_text())


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_the_true_pose_of_a_users_binary_goes_into_the_ring(kind: FlavourName, speaking: Path, ring: TruthRing) -> None:
    running = start_external(f"{kind}:{speaking}", AutopilotConfig(flavour=kind), ring.name)
    try:
        assert running.url.startswith("udpin://127.0.0.1:")
        assert running.operator_url.startswith("udpout://" if kind == "px4" else "tcpout://")
        time.sleep(1.0)
        history = ring.history()
        assert 25 < len(history) < 80  # 50 Hz
        newest = history[-1]
        np.testing.assert_allclose(newest.velocity_enu_m_s, [2.0, 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(newest.position_enu_m[1:], [0.0, 3.0], atol=0.02)
        assert newest.position_enu_m[0] > 0.5
        assert abs(newest.world_from_body_wxyz @ [0.0, 1.0, 0.0, 0.0]) == pytest.approx(1.0, abs=1e-6)
    finally:
        running.stop()
        running.stop()
    assert not running.alive


def test_an_ardupilot_is_flown_once_its_estimator_is_ready_and_one_that_dies_is_noticed(
    speaking: Path, ring: TruthRing
) -> None:
    running = start_external(f"ardupilot:{speaking}", AutopilotConfig(flavour="ardupilot"), ring.name)
    try:
        with pytest.raises(LinkError, match="no position after"):
            running.await_estimator(timeout_s=0.0)
        running.await_estimator(timeout_s=15.0)
        running.check_alive()
        os.kill(running.pid, signal.SIGKILL)
        while running.alive:
            time.sleep(0.02)
        with pytest.raises(LinkError, match="ended in flight"):
            running.check_alive()
    finally:
        running.stop()


def test_a_binary_that_flies_elsewhere_is_not_believed(speaking: Path, ring: TruthRing) -> None:
    config = AutopilotConfig(parameters=(("COM_OBL_RC_ACT", 7),))
    with pytest.raises(LinkError, match="km from the scenario's home"):
        start_external(f"px4:{speaking}", config, ring.name)


def test_a_binary_that_ends_or_is_silent_is_an_error_that_quotes_it(tmp_path: Path, ring: TruthRing) -> None:
    ending = executable(tmp_path, "print('no such model')")
    with pytest.raises(LinkError, match="no such model"):
        start_external(f"ardupilot:{ending}", AutopilotConfig(), ring.name)
    broken = executable(tmp_path, "")
    broken.write_bytes(b"\x7fELF of another machine")
    with pytest.raises(LinkError, match="cannot be started"):
        start_external(f"ardupilot:{broken}", AutopilotConfig(), ring.name)
    silent = executable(tmp_path, "import time; time.sleep(30)")
    with pytest.raises(LinkError, match="tells no true pose"):
        start_external(f"ardupilot:{silent}", AutopilotConfig(), ring.name, timeout_s=0.5)


@pytest.mark.parametrize("text", ["px4", "ardupilot:", "betaflight:x", "px4:/no/such/file"])
def test_what_is_no_binary_is_refused(text: str, ring: TruthRing) -> None:
    with pytest.raises(SettingsError):
        start_external(text, AutopilotConfig(), ring.name)


def test_nonsense_and_other_messages_are_no_truth() -> None:
    zero = mavlink.MAVLink_sim_state_message(0, 0, 0, 0, *[0.0] * 17)
    assert true_state(zero, PLACE, 0.0) is None
    nan = mavlink.MAVLink_sim_state_message(1, 0, 0, 0, *[float("nan")] * 17)
    assert true_state(nan, PLACE, 0.0) is None
    assert true_state(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3), PLACE, 0.0) is None
