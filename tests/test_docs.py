"""The documentation's examples: commands parse as they stand there, quick ones run, links lead somewhere."""

from __future__ import annotations

import doctest
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.core import TyperGroup

import mission
from gcs_plugin.cli.app import program
from gcs_plugin.geotags.geotag import COLUMNS
from gcs_plugin.geotags.log import GeotagLog
from tests.support.sample import geotag

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
QUICK = ("settings", "plan", "estimate", "export", "actions", "draw")
"""Commands that run in seconds, without an aircraft; their examples use `flight.jsonl` and `flights/geotags.gpkg`."""

_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")


def commands() -> list[tuple[str, str]]:
    """Page and line of every `sidestep` command in a block."""
    found = []
    for page in PAGES:
        for kind, text in _BLOCK.findall(page.read_text(encoding="utf-8")):
            if kind in ("", "sh", "bash", "shell"):
                joined = text.replace("\\\n", " ")
                found += [(page.name, line.strip()) for line in joined.splitlines() if line.startswith("sidestep ")]
    return found


def arguments(line: str) -> list[str]:
    """What the shell gives to `sidestep`."""
    words = shlex.split(line, comments=True)[1:]
    ends = [index for index, word in enumerate(words) if word in (">", "|", "||", "&&", "&")]
    return words[: min(ends, default=len(words))]


def with_files(folder: Path) -> None:
    """The files that examples use."""
    shutil.copy(ROOT / "tests" / "data" / "one-flight.jsonl", folder / "flight.jsonl")
    (folder / "flights").mkdir()
    GeotagLog(folder / "flights" / "geotags.gpkg").append(geotag())


@pytest.mark.parametrize(("page", "line"), commands())
def test_every_command_takes_its_arguments(page: str, line: str) -> None:
    group = program()
    words = arguments(line)
    while words and words[0] in group.commands:
        context = group.commands[words[0]].make_context(words[0], words[1:])
        if not isinstance(context.command, TyperGroup):
            return  # parsed whole
        group, words = context.command, words[1:]
    assert words in ([], ["--help"], ["--version"]), f"{page}: there is no such command: {line}"


@pytest.mark.parametrize(("page", "line"), [found for found in commands() if arguments(found[1])[0] in QUICK])
def test_quick_commands_run(page: str, line: str, tmp_path: Path) -> None:
    with_files(tmp_path)
    command = re.sub(r"^sidestep\b", shlex.join([sys.executable, "-m", "gcs_plugin"]), line)
    command = command.replace("~/Documents", str(tmp_path))
    done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("page", [page for page in PAGES if ">>> " in page.read_text()], ids=lambda page: page.name)
def test_python_examples_print_what_stands_there(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    done = doctest.testfile(str(page), module_relative=False, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert done.attempted
    assert not done.failed


def test_the_example_of_the_package_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    done = doctest.testmod(mission, extraglobs={"Path": Path})
    assert done.attempted
    assert not done.failed


def test_every_public_name_leads_somewhere() -> None:
    assert all(getattr(mission, name) is not None for name in mission.__all__)
    with pytest.raises(AttributeError, match="nothing"):
        _ = mission.nothing


def test_the_pages_build_without_warnings(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "library.html").exists()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files_that_are_there(page: Path) -> None:
    for target in _LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


def test_every_column_of_a_geotag_is_documented() -> None:
    text = (ROOT / "docs" / "geotags.md").read_text(encoding="utf-8")
    assert not [column.name for column in COLUMNS if f"`{column.name}`" not in text]
