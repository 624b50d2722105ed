"""What an autopilot's GPS receivers report (GPS_RAW_INT, GPS2_RAW): the best one counts, as for its filter."""

from __future__ import annotations

from typing import Any, Final

_FRESH_S: Final = 5.0
"""A receiver that is silent for longer has no fix."""


class GpsReceivers:
    """The receivers of one vehicle."""

    def __init__(self) -> None:
        self.fix = 0
        """GPS_FIX_TYPE of the best one."""
        self.accuracy_m: float | None = None
        self.geoid_separation_m: float | None = None
        """Ellipsoid height less altitude above mean sea level, where it tells both."""
        self._fixes: dict[str, tuple[float, int]] = {}

    def take(self, message: Any, now_s: float) -> None:
        """Take in GPS_RAW_INT or GPS2_RAW."""
        name = message.get_type()
        self._fixes[name] = now_s, message.fix_type
        fixes = {each: fix for each, (t_s, fix) in self._fixes.items() if now_s - t_s < _FRESH_S}
        self.fix = max(fixes.values())
        if name != max(fixes, key=lambda each: (fixes[each], each == "GPS_RAW_INT")):
            return  # the other receiver is the better one
        self.accuracy_m = message.h_acc * 1e-3 if message.h_acc else None
        # The same to the millimetre: a receiver without a model of the geoid gives one for the other.
        separation_mm = message.alt_ellipsoid - message.alt if message.alt_ellipsoid else 0
        self.geoid_separation_m = separation_mm * 1e-3 if separation_mm else None
