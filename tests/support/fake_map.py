"""A MAVProxy module that stands in for its `map`, which needs a screen: keeps what is drawn on it.

``fakemap`` prints the keys and what they are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from MAVProxy.modules.lib import mp_module


class FakeSlipMap:
    def __init__(self) -> None:
        self.objects: dict[str, Any] = {}

    def icon(self, name: str) -> Any:
        return np.zeros((16, 16, 3), np.uint8)

    def add_object(self, part: Any) -> None:
        self.objects[part.key] = part

    def remove_object(self, key: str) -> None:
        del self.objects[key]


class FakeMap(mp_module.MPModule):  # type: ignore[misc]
    def __init__(self, mpstate: Any) -> None:
        super().__init__(mpstate, "map", "a map without a screen", public=True)
        self.map = FakeSlipMap()
        self.add_command("fakemap", self.show, "what is on the map")

    def show(self, words: list[str]) -> None:
        for key, part in sorted(self.map.objects.items()):
            points = len(part.points) if hasattr(part, "points") else part.label
            self.console.writeln(f"on the map: {key}: {type(part).__name__} {points}")
        self.console.writeln(f"{len(self.map.objects)} objects on the map")


def init(mpstate: Any) -> FakeMap:
    return FakeMap(mpstate)
