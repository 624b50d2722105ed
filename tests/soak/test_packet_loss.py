"""`sidestep locate` over bad links, on the whole simulation; the video's own link is good."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from sitl.autopilot import Mode
from sitl.faults import LinkFaults
from tests.sitl.simulation.test_run import SCENARIO
from tests.soak.conftest import Note
from tests.support.airborne import PATTERN, TAKE_OFF, Airborne, airborne

pytestmark = [pytest.mark.soak, pytest.mark.timeout(900)]

RUNS = 3
HOLDS = ("hold", "brake")


@pytest.fixture(params=["px4", "ardupilot"])
def aircraft(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Airborne]:
    scenario = SCENARIO.replace("[autopilot]", f'[autopilot]\nflavour = "{request.param}"')
    with airborne(scenario, tmp_path) as found:
        if request.param == "px4":
            found.set_integer("COM_OBL_RC_ACT", 5)
        found.attempts = 1
        yield found


@pytest.mark.parametrize("loss", [0.05, 0.2])
def test_locate_succeeds_over_a_link_that_loses(aircraft: Airborne, loss: float, note: Note) -> None:
    aircraft.relay.set(LinkFaults(loss=loss, duplicate=0.02, reorder=0.02))
    errors = []
    for i in range(RUNS):
        result, said = aircraft.locate(*(TAKE_OFF if i == 0 else ()))
        assert result.exit_code == 0, said
        assert result.score is not None
        errors.append(result.score.depth_error_pct)
    note(f"{aircraft.running.scenario.autopilot.flavour}: depth error at {100 * loss:.0f} % loss (%)", errors)
    assert max(errors) < 15.0


def test_40_percent_loss_refuses_the_take_off(aircraft: Airborne) -> None:
    aircraft.relay.set(LinkFaults(loss=0.4))
    result, said = aircraft.locate(*TAKE_OFF)
    assert result.exit_code == 1
    assert "of the packets, more than 30 %" in said, said
    assert aircraft.autopilot.state()["armed"] is False


def test_40_percent_loss_in_the_pattern_ends_it_and_the_aircraft_holds(aircraft: Airborne) -> None:
    result, said = aircraft.locate(*TAKE_OFF)
    assert result.exit_code == 0, said
    for _ in range(RUNS):
        code, said = aircraft.locate_until(PATTERN, lambda _: aircraft.relay.set(LinkFaults(loss=0.4)))
        aircraft.relay.set(LinkFaults())
        assert code == 1
        assert "% of the packets" in said, said
        assert aircraft.comes_to_rest()
        assert aircraft.autopilot.state()["mode"] in HOLDS
    aircraft.relay.set(LinkFaults(loss=0.4))
    result, said = aircraft.locate()
    assert result.exit_code == 1
    assert "of the packets, more than 30 %" in said, said
    assert aircraft.comes_to_rest()


def test_a_cut_link_in_the_pattern_is_a_clear_error_and_the_aircraft_holds(aircraft: Airborne) -> None:
    result, said = aircraft.locate(*TAKE_OFF)
    assert result.exit_code == 0, said
    for _ in range(RUNS):
        code, said = aircraft.locate_until(PATTERN, lambda _: aircraft.relay.set(LinkFaults(cut=True)))
        assert aircraft.comes_to_rest()
        aircraft.relay.set(LinkFaults())
        assert code == 1
        assert "position is no longer received" in said
        events = [json.loads(line) for line in (aircraft.newest_folder() / "events.jsonl").read_text().splitlines()]
        assert events[-1]["kind"] == "failed"
        aircraft.autopilot.switch(Mode.HOLD)  # the operator ends the failsafe
