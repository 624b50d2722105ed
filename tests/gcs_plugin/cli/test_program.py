"""The `sidestep` command as a whole: what it loads to list its commands, its version, its exit codes."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import EntryPoint, version
from pathlib import Path

import pytest

from gcs_plugin.cli import app as program
from gcs_plugin.cli.exit_codes import ExitCode, exit_code
from gcs_plugin.cli.lazy import summary
from gcs_plugin.cli.missing_extra import extra_of, missing_extra
from mission import errors

MODULES_BEFORE = 1700
MOST_KIB = 90 * 1024

LISTING = """
import json, sys
sys.argv = ["sidestep", "--help"]
from gcs_plugin.cli import main
try:
    main()
except SystemExit:
    pass
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print("\\n" + json.dumps([sorted(sys.modules), int(peak.split()[1])]))
"""


@dataclass(frozen=True)
class Ran:
    code: int
    out: str
    said: str


def sidestep(*arguments: str) -> Ran:
    done = subprocess.run(
        [sys.executable, "-m", "gcs_plugin", *arguments], capture_output=True, text=True, timeout=60, check=False
    )
    return Ran(done.returncode, done.stdout, done.stderr)


def test_the_listing_names_every_command_and_loads_none() -> None:
    done = subprocess.run([sys.executable, "-c", LISTING], capture_output=True, text=True, timeout=60, check=True)
    modules, peak_kib = json.loads(done.stdout.splitlines()[-1])
    for name in (*program.COMMANDS, "sitl"):
        assert f" {name} " in done.stdout
    assert len(modules) < 0.3 * MODULES_BEFORE
    assert peak_kib < MOST_KIB
    heavy = {"numpy", "scipy", "cv2", "av", "matplotlib", "pymavlink", "mavsdk", "panda3d", "pydantic", "pyproj"}
    assert not heavy.intersection(modules)


def test_version() -> None:
    ran = sidestep("--version")
    assert (ran.code, ran.out) == (0, f"sidestep {version('sidestep')}\n")


def test_a_command_that_is_nearly_right_is_named() -> None:
    ran = sidestep("estimte")
    assert ran.code == ExitCode.UNUSABLE
    assert "estimate" in ran.said


@pytest.mark.parametrize("name", program.COMMANDS)
def test_every_command_has_a_sentence_in_the_listing(name: str) -> None:
    sentence = summary(f"gcs_plugin.cli.{name}")
    assert sentence[:1].isupper()
    assert sentence.endswith(".")


def test_commands_of_other_packages_are_listed_by_their_entry_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "weather_cli.py").write_text(
        '"""`sidestep weather`: look out of the window."""\nimport not_there_xyz\n'
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    entry = EntryPoint("weather", "weather_cli:register", "sidestep.commands")
    monkeypatch.setattr(program, "entry_points", lambda **_: [entry])
    commands = program.program().commands
    assert commands["weather"].help == "Look out of the window."
    assert "weather_cli" not in sys.modules


REQUIREMENTS = [
    "numpy<3,>=1.26",
    'panda3d<1.11,>=1.10.15; extra == "sitl"',
    'MAVProxy<1.8.75,>=1.8.74; extra == "mavproxy"',
    "future>=1.0 ; extra == 'mavproxy'",
]


@pytest.mark.parametrize(
    ("module", "extra"), [("panda3d", "sitl"), ("MAVProxy", "mavproxy"), ("future", "mavproxy"), ("numpy", None)]
)
def test_the_extra_that_brings_a_module_is_found_in_the_metadata(module: str, extra: str | None) -> None:
    assert extra_of(module, REQUIREMENTS) == extra


def test_a_missing_extra_is_named_and_a_missing_file_of_the_program_is_not_taken_for_one() -> None:
    named = missing_extra(ModuleNotFoundError("No module named 'panda3d'", name="panda3d.core"))
    assert named is not None
    assert "pip install 'sidestep[sitl]'" in str(named)
    assert missing_extra(ModuleNotFoundError("No module named 'mission.x'", name="mission.x")) is None


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.SettingsError("x"), 2),
        (errors.SightingsFormatError("x"), 2),
        (errors.CalibrationInputError("x"), 2),
        (errors.CalibrationError("x"), 1),
        (errors.LinkError("x"), 1),
        (errors.FlightRefused("x"), 1),
        (errors.EstimateRefused("x"), 1),
        (errors.AnswerError("x"), 1),
    ],
)
def test_what_cannot_be_used_is_2_and_what_failed_is_1(error: errors.SidestepError, code: int) -> None:
    assert exit_code(error) == code


@pytest.mark.parametrize(
    "arguments",
    [
        ("nosuch",),
        ("settings", "--nosuch"),
        ("estimate", "none.jsonl"),
        ("plan", "--distance-m", "9", "--sigma-m", "0.3", "--camera", "none.toml"),
        ("locate", "--settings", "none.toml"),
        ("locate", "--camera", "none.toml"),
        ("locate", "--drone", "nowhere"),
        ("serve", "--settings", "none.toml"),
        ("draw", "none"),
        ("export", "none.gpkg", "--format", "csv"),
        ("export", __file__, "--format", "csv"),
        ("calibrate", "board", "none", "--columns", "9", "--rows", "6", "--square-mm", "25", "-o", "c.toml"),
        ("sitl", "none.toml"),
    ],
    ids=" ".join,
)
def test_a_file_or_argument_that_cannot_be_used_is_always_2_with_a_message(arguments: tuple[str, ...]) -> None:
    ran = sidestep(*arguments)
    assert ran.code == ExitCode.UNUSABLE
    assert ran.said
    assert "Traceback" not in ran.said
