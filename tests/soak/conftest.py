"""The figures of the long tests end their run (``make soak``)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

Note = Callable[[str, list[float]], None]
_FIGURES: list[str] = []


@pytest.fixture
def note() -> Note:
    """Keeps a figure of a name and its runs' values for the summary."""

    def keep(name: str, values: list[float]) -> None:
        found = np.array(values)
        text = f"median {np.median(found):.3f}, worst {found.max():.3f}" if len(found) else "none"
        _FIGURES.append(f"{name}: {text} (n = {len(found)})")

    return keep


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """The figures."""
    for line in _FIGURES:
        terminalreporter.write_line(line)
