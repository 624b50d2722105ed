"""The number in a PARAM_VALUE (https://mavlink.io/en/services/parameter.html, parameter encoding)."""

from __future__ import annotations

import math
import struct
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.state.modes import Autopilot


def number_of(message: Any, autopilot: Autopilot) -> float | None:
    """Its number, None where it is none: PX4 puts an integer's bytes into the float, ArduPilot its value."""
    value = float(message.param_value)
    if autopilot == "px4" and message.param_type != mavlink.MAV_PARAM_TYPE_REAL32:
        return float(struct.unpack("<i", struct.pack("<f", value))[0])
    return value if math.isfinite(value) else None
