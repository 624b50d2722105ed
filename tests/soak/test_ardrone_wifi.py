"""The AR.Drone on a Wi-Fi that loses 20 % and doubles and reorders 10 %: an answer, or hover with a clear reason."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

import sitl
from sitl.run import locate, scored
from sitl.scenario import read_scenario
from sitl.simulation import Simulation, simulation

BAD_WIFI = Path(sitl.__file__).parent / "scenarios" / "ardrone-faults" / "bad-wifi.toml"
REASONS = (
    "lost while",
    "no longer received",
    "no picture",
    "no person found",
    "nobody to follow",
    "was not done within",
    "not determined",
    "link",
)
"""What a mission may end with on such a link; anything else is a fault of the program."""


pytestmark = [pytest.mark.soak, pytest.mark.timeout(600)]
SETTLES_S = 8.0


def comes_to_hover(running: Simulation) -> bool:
    """Whether the aircraft soon keeps its place in the air."""
    deadline = time.monotonic() + SETTLES_S
    while not (still := _hovers(running)) and time.monotonic() < deadline:
        time.sleep(0.1)
    return still


def _hovers(running: Simulation) -> bool:
    """Whether it is in the air and hardly moved in the last second that is known."""
    history = running.ring.history()
    last = [truth for truth in history if truth.t_s > history[-1].t_s - 1.0]
    moved = np.linalg.norm(last[-1].position_enu_m - last[0].position_enu_m)
    return bool(last[-1].position_enu_m[2] > 0.5 and moved < 0.5)


def test_the_mission_completes_or_ends_in_hover_with_a_clear_reason(tmp_path: Path) -> None:
    with simulation(read_scenario(BAD_WIFI), tmp_path) as running:
        code, said = locate(running, ["--take-off", "1.0"])
        result = scored(running, tmp_path, code, said)
        assert comes_to_hover(running), result.error
    if result.score is None:
        assert code != 0
        assert any(words in result.error for words in REASONS), result.error
    else:
        assert code == 0
        assert result.score.depth_error_pct < 30.0
