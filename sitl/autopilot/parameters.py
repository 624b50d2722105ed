"""The autopilot's parameters and how PARAM_VALUE carries them.

PX4 puts an integer's bytes into the float field, ArduPilot its value (MAVLink's parameter protocol, its encodings).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from pymavlink.dialects.v20 import all as mavlink


class Parameters:
    """Names to numbers, in a fixed order; a parameter keeps its type."""

    def __init__(self, defaults: Mapping[str, int | float], changes: Mapping[str, float], bytewise: bool) -> None:
        self._values: dict[str, int | float] = dict(sorted(defaults.items()))
        self._bytewise = bytewise
        for name, value in changes.items():
            if name not in self._values:
                raise KeyError(f"this autopilot has no parameter {name}")
            self.set_number(name, value)

    def __len__(self) -> int:
        return len(self._values)

    def number(self, name: str) -> float:
        """The value of a parameter that is known to exist."""
        return float(self._values[name])

    def set_number(self, name: str, value: float) -> None:
        """Change a parameter that exists; integers are rounded."""
        self._values[name] = round(value) if isinstance(self._values[name], int) else float(value)

    def name_at(self, index: int) -> str | None:
        """The name with an index, None outside the table."""
        return list(self._values)[index] if 0 <= index < len(self._values) else None

    def known(self, name: str) -> bool:
        """Whether there is such a parameter."""
        return name in self._values

    def value_message(self, name: str, index: int | None = None) -> mavlink.MAVLink_param_value_message:
        """PARAM_VALUE of a parameter."""
        value = self._values[name]
        kind = mavlink.MAV_PARAM_TYPE_INT32 if isinstance(value, int) else mavlink.MAV_PARAM_TYPE_REAL32
        raw = float(value)
        if self._bytewise and isinstance(value, int):
            raw = struct.unpack("<f", struct.pack("<i", value))[0]
        at = list(self._values).index(name) if index is None else index
        return mavlink.MAVLink_param_value_message(name.encode(), raw, kind, len(self), at)

    def decode(self, name: str, raw: float, kind: int) -> float | None:
        """The number in a PARAM_SET for this parameter; None if it is not one."""
        if self._bytewise and isinstance(self._values.get(name), int):
            if kind == mavlink.MAV_PARAM_TYPE_REAL32:
                return None
            return float(struct.unpack("<i", struct.pack("<f", raw))[0])
        return raw if math.isfinite(raw) else None


def decode_name(raw: str | bytes) -> str:
    """A parameter's name from the wire."""
    text = raw.decode("ascii", "replace") if isinstance(raw, bytes) else raw
    return text.split("\0")[0]
