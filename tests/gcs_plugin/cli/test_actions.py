"""The file is one that QGroundControl takes: the checks of its MavlinkActionManager, and its documented fields."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from gcs_plugin.cli.actions import FILE_NAME, actions_file, register
from gcs_plugin.component.identity import Identity
from gcs_plugin.component.orders import STOP_COMMANDS, HandToAutopilot, LocateOrder, NextCandidate, order_of
from mission.errors import SettingsError

REQUIRED = {"label": str, "description": str, "mavCmd": int}
OPTIONAL = {"compId", *(f"param{i}" for i in range(1, 8))}
JOYSTICK_NAMES = {"Arm", "Disarm", "Emergency Stop", "Trigger Camera", "Gimbal Center"}
"""Some of QGroundControl's own, which a label must not repeat."""


@pytest.fixture
def app() -> typer.Typer:
    app = typer.Typer()
    app.callback()(lambda: None)  # with a single command typer would leave its name out
    register(app)
    return app


def test_qgroundcontrol_takes_the_file() -> None:
    content = json.loads(actions_file(Identity(1).component))
    assert set(content) == {"version", "fileType", "actions"}
    assert (content["version"], content["fileType"]) == (1, "MavlinkActions")
    labels = [action["label"] for action in content["actions"]]
    assert len(set(labels)) == len(labels)
    assert not JOYSTICK_NAMES.intersection(labels)
    for action in content["actions"]:
        assert set(action) <= set(REQUIRED) | OPTIONAL
        for key, kind in REQUIRED.items():
            assert isinstance(action[key], kind)
        assert all(isinstance(action[key], int | float) for key in OPTIONAL & set(action))


def test_every_button_is_an_order_that_the_component_knows_and_abort_is_among_them() -> None:
    actions = json.loads(actions_file(100))["actions"]
    orders = [
        order_of(action["mavCmd"], (action.get("param1", 0), 0.0, 0.0, 0.0), box_locates=True)
        for action in actions
        if action["mavCmd"] not in STOP_COMMANDS
    ]
    assert orders == [
        LocateOrder(),
        NextCandidate(),
        HandToAutopilot(roi=True, waypoint=False),
        HandToAutopilot(roi=False, waypoint=True),
    ]
    assert [action["label"] for action in actions if action["mavCmd"] in STOP_COMMANDS] == ["Locate: abort"]


def test_the_buttons_address_the_component_that_is_named(app: typer.Typer, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["actions", "--output", str(tmp_path / "new"), "--component", "103"])
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "new" / FILE_NAME).read_text(encoding="utf-8"))
    assert {action["compId"] for action in content["actions"]} == {103}


@pytest.mark.parametrize("component", ["99", "106", "x"])
def test_a_component_that_qgroundcontrol_would_not_show_is_refused(app: typer.Typer, component: str) -> None:
    assert CliRunner().invoke(app, ["actions", "--component", component]).exit_code == 2


def test_a_folder_that_cannot_be_made_is_explained(app: typer.Typer, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = CliRunner().invoke(app, ["actions", "--output", str(tmp_path / "file")])
    assert isinstance(result.exception, SettingsError)
