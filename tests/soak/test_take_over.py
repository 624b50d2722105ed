"""A pilot who takes the aircraft out of the pattern of `sidestep locate`, on the whole simulation."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from sitl.autopilot import Mode
from tests.sitl.simulation.test_run import SCENARIO
from tests.support.airborne import PATTERN, TAKE_OFF, Airborne, airborne

pytestmark = [pytest.mark.soak, pytest.mark.timeout(300)]


def switch(aircraft: Airborne, mode: Mode, _: object) -> None:
    aircraft.autopilot.switch(mode)


def test_the_pilot_takes_over_and_keeps_the_aircraft(tmp_path: Path) -> None:
    with airborne(SCENARIO, tmp_path) as aircraft:
        aircraft.set_integer("COM_OBL_RC_ACT", 5)
        first, said = aircraft.locate(*TAKE_OFF)
        assert first.exit_code == 0, said
        for mode in (Mode.HOLD, Mode.LAND):
            code, said = aircraft.locate_until(PATTERN, partial(switch, aircraft, mode))
            assert code == 1, said
            assert "not by us" in said
            assert aircraft.autopilot.state()["mode"] == mode.value
