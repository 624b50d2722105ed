"""The scenarios that come with the program, and the grid of the closed-loop table: 4 ways of walking x 4 distances."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from mission.errors import SettingsError
from sitl.scenario import Scenario, parse_scenario, read_scenario


def named_scenario(name: str) -> Scenario:
    """A scenario that comes with the program, such as ``demo`` or ``paper/parallel-5-50``.

    Raises:
        SettingsError: there is none of this name.
    """
    entry = files("sitl") / "scenarios" / f"{name}.toml"
    if not entry.is_file():
        raise SettingsError(f"there is no scenario called {name}", "name a file, or one of sitl/scenarios")
    return parse_scenario(entry.read_text("utf-8"), f"{name}.toml")


def paper_grid() -> list[Scenario]:
    """Stationary, parallel, perpendicular, diagonal at 0.6 m/s, each begun at 2.75, 5.5, 7.25 and 9 m."""
    folder = Path(str(files("sitl"))) / "scenarios" / "paper"
    return [read_scenario(path) for path in sorted(folder.glob("*.toml"))]
