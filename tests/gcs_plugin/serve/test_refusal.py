"""Why an order is refused before it is accepted, as far as telemetry tells."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gcs_plugin.component import Follow, LocateOrder, Mark, NextCandidate
from gcs_plugin.serve.vehicle import refusal
from mission.settings import CameraSettings, MissionSettings
from mission.vehicle.drone import Telemetry

SETTINGS = MissionSettings()
FLYING = Telemetry(100.0, True, True, True, "HOLD", 0.8, 2.0, 0.5, True, True, 50.0)


def test_an_aircraft_in_the_air_and_well_may_locate() -> None:
    assert refusal(LocateOrder(), FLYING, SETTINGS) == ""


@pytest.mark.parametrize(
    ("telemetry", "reason"),
    [
        (replace(FLYING, connected=False), "not heard"),
        (replace(FLYING, armed=False), "not armed and airborne"),
        (replace(FLYING, in_air=False), "not armed and airborne"),
        (replace(FLYING, position_ok=False), "position is not healthy"),
        (replace(FLYING, heading_ok=False), "heading is not healthy"),
        (replace(FLYING, battery_fraction=0.1), "battery is at 10 %"),
        (replace(FLYING, gimbal="MNT1_TYPE is 1"), "carries a gimbal (MNT1_TYPE is 1)"),
    ],
)
def test_one_that_could_not_is_refused_with_the_reason(telemetry: Telemetry, reason: str) -> None:
    assert reason in refusal(LocateOrder(), telemetry, SETTINGS)


def test_an_unknown_battery_is_left_to_the_pilot_process() -> None:
    assert refusal(LocateOrder(), replace(FLYING, battery_fraction=None), SETTINGS) == ""


def test_what_does_not_fly_needs_no_aircraft_in_the_air() -> None:
    landed = replace(FLYING, armed=False, in_air=False)
    assert refusal(Follow(Mark(0.1, 0.1, 0.2, 0.2)), landed, SETTINGS) == ""
    assert refusal(NextCandidate(), landed, SETTINGS) == ""


def test_an_operator_may_say_that_the_camera_is_not_on_the_gimbal() -> None:
    settings = SETTINGS.model_copy(update={"camera": CameraSettings(ignore_gimbal=True)})
    assert refusal(LocateOrder(), replace(FLYING, gimbal="MNT1_TYPE is 1"), settings) == ""
