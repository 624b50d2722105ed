"""The located targets as a page shows them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from gcs_plugin.exports.targets import Targets
from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.grid import grid_reference
from gcs_plugin.geotags.outline import ellipse_rings, velocity_arrow
from gcs_plugin.geotags.words import motion_in_words, moves, name_of
from gcs_plugin.xml_text import zulu

SHOWN: Final = 100
_SURE: Final = ((1.0, "within a step"), (3.0, "within a few steps"), (10.0, "within a house"), (50.0, "rough"))


class TargetList:
    """The newest targets of the log, read again whenever it has changed.

    Args:
        log: where the log is.
        clock: monotonic seconds.
    """

    def __init__(self, log: Path, clock: Callable[[], float]) -> None:
        self._targets = Targets(lambda: log)
        self._clock = clock
        self._told: Sequence[Geotag] = ()
        self._fresh: dict[str, Geotag] = {}
        self.version = 0

    def tell(self, geotag: Geotag) -> None:
        """An answer that is not in the log yet."""
        self._fresh[geotag.id] = geotag
        while len(self._fresh) > SHOWN:
            del self._fresh[next(iter(self._fresh))]

    def newest(self) -> Sequence[Geotag]:
        """Oldest first, those that the log does not hold yet among them."""
        logged = self._targets.newest(SHOWN, self._clock())
        known = {geotag.id for geotag in logged}
        found = [*logged, *(geotag for name, geotag in list(self._fresh.items()) if name not in known)]
        if [g.id for g in found] != [g.id for g in self._told]:
            self.version += 1
            self._told = found
        return self._told

    def find(self, number: int) -> Geotag | None:
        """The target with this number."""
        return next((geotag for geotag in reversed(self.newest()) if geotag.number == number), None)


def target_json(geotag: Geotag) -> Mapping[str, object]:
    """One target for the page."""
    arrow = velocity_arrow(geotag) if moves(geotag) else None
    return {
        "id": geotag.id,
        "number": geotag.number,
        "name": name_of(geotag),
        "time": zulu(geotag.time_utc),
        "lat": geotag.place.lat_deg,
        "lon": geotag.place.lon_deg,
        "altitude": f"{geotag.place.alt_m:.1f} m ({geotag.place.datum})",
        "mgrs": grid_reference(geotag.place.lat_deg, geotag.place.lon_deg),
        "ce90": round(geotag.ce90_m, 2),
        "le90": round(geotag.le90_m, 2),
        "sure": next((words for limit, words in _SURE if geotag.ce90_m < limit), "very rough"),
        "motion": motion_in_words(geotag),
        "distance": round(geotag.depth_m, 1),
        "semiMajor": round(geotag.ellipse.semi_major_m, 2),
        "semiMinor": round(geotag.ellipse.semi_minor_m, 2),
        "azimuth": round(math.degrees(geotag.ellipse.azimuth_rad), 1),
        "rings": ellipse_rings(geotag),
        "arrow": arrow[:2] if arrow is not None else None,
        "picture": bool(geotag.picture),
        "notes": list(geotag.notes),
    }
