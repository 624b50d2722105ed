"""Where the pilot's throttle stick is (RC_CHANNELS): what a mode with sticks would do when control is given back."""

from __future__ import annotations

from typing import Any, Final

_FRESH_S: Final = 2.0
_MIDDLE_US, _RESTS_US = 1500, 100
"""ArduPilot's dead band (THR_DZ) is a tenth of the way; just beyond it the vehicle climbs or sinks by centimetres."""
_PULSES_US = (800, 2200)


class Sticks:
    """The throttle stick."""

    def __init__(self) -> None:
        self.heard = False
        """Whether the autopilot says that it hears a remote control."""
        self.throttle_channel = 3
        self._throttle_us: int | None = None
        self._told_s = 0.0

    def take(self, message: Any, now_s: float) -> None:
        """Take in RC_CHANNELS."""
        told = self.throttle_channel <= message.chancount
        pulse = getattr(message, f"chan{self.throttle_channel}_raw") if told else 0
        self._throttle_us, self._told_s = (pulse if _PULSES_US[0] <= pulse <= _PULSES_US[1] else None), now_s

    def rest(self, now_s: float) -> bool:
        """Whether a remote control is heard and its throttle stick rests in the middle."""
        if not self.heard or self._throttle_us is None or now_s - self._told_s > _FRESH_S:
            return False
        return abs(self._throttle_us - _MIDDLE_US) <= _RESTS_US
