"""ArduPilot's onboard logs (BIN), read with pymavlink's DFReader."""

from __future__ import annotations

import contextlib
import io
import math
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
from pymavlink import DFReader

from mission.errors import LogError
from mission.logs.pose_log import PoseLog
from mission.logs.series import (
    from_euler,
    gps_time_utc_s,
    median_or_none,
    pose_noise,
    positions,
    utc_at_zero,
)

MAGIC: Final = b"\xa3\x95"
_TYPES: Final = ["ATT", "POS", "XKF1", "NKF1", "GPS", "GPA", "MNT"]
_LEAST_FIX = 3


def read_dataflash(path: Path) -> PoseLog:
    """The flight in a BIN file.

    Positions from POS, velocities from the estimator's first core (XKF1), attitude from ATT, a gimbal's from MNT.

    Raises:
        LogError: it is damaged from the start, or holds no flight.
        OSError: it cannot be read.
    """
    rows = _Rows()
    # DFReader prints what it skips.
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        try:
            log = DFReader.DFReader_binary(str(path))
        except (ValueError, KeyError, IndexError, TypeError, struct.error, UnicodeDecodeError, AttributeError) as error:
            raise LogError(f"{path.name} is no ArduPilot log that can be read ({error})", _REMEDY) from error
        try:
            while (message := _next(log)) is not None:
                rows.take(message)
        except (ValueError, KeyError, IndexError, TypeError, struct.error, UnicodeDecodeError) as error:
            rows.broken = str(error)
        finally:
            log.close()
    if not rows.place:
        raise LogError(f"{path.name} holds no positions (POS)", "Give the log of a flight that had a GPS fix.")
    speed = None
    if len(rows.speed_s) > 1:
        at = np.array(rows.speed_s)
        order = np.argsort(at, kind="stable")
        told = np.array(rows.speed)[order]
        speed = np.column_stack([np.interp(rows.place_s, at[order], told[:, axis]) for axis in range(3)])
    origin, series = positions(rows.place_s, rows.place, speed)
    aircraft, gimbal = from_euler(rows.turned_s, rows.turned), from_euler(rows.held_s, rows.held)
    accuracy = median_or_none(rows.accuracy)
    height = np.array(rows.height)
    known = np.isfinite(height)
    take_off = float(np.median((np.array(rows.place)[:, 2] - height)[known])) - origin.alt_m if known.any() else None
    return PoseLog(
        "dataflash",
        "vehicle",
        origin,
        series,
        aircraft,
        gimbal,
        pose_noise(accuracy, gimbal or aircraft, gimbal=gimbal is not None),
        utc_at_zero_s=utc_at_zero(rows.utc),
        accuracy_m=accuracy,
        take_off_up_m=take_off,
        notes=(f"the log is damaged ({rows.broken}): what comes after is not used",) if rows.broken else (),
    )


_REMEDY: Final = "Copy it from the card again."


def _next(log: Any) -> Any:
    return log.recv_match(type=_TYPES)


class _Rows:
    """What the messages tell, in the order of the file; times are the vehicle's."""

    def __init__(self) -> None:
        self.place_s: list[float] = []
        self.place: list[tuple[float, float, float]] = []
        self.height: list[float] = []
        self.speed_s: list[float] = []
        self.speed: list[tuple[float, float, float]] = []
        self.turned_s: list[float] = []
        self.turned: list[tuple[float, float, float]] = []
        self.held_s: list[float] = []
        self.held: list[tuple[float, float, float]] = []
        self.accuracy: list[float] = []
        self.utc: list[tuple[float, float]] = []
        self.broken = ""

    def take(self, message: Any) -> None:
        """Of a message; one without a field that is needed (an older format) is passed over."""
        told, name = message.to_dict(), message.get_type()
        t_s = float(told.get("TimeUS", math.nan)) * 1e-6
        if not math.isfinite(t_s):
            return
        if name == "ATT" and "Yaw" in told:
            self.turned_s.append(t_s)
            self.turned.append((told["Roll"], told["Pitch"], told["Yaw"]))
        elif name == "POS" and "Alt" in told:
            self.place_s.append(t_s)
            self.place.append((told["Lat"], told["Lng"], told["Alt"]))
            self.height.append(told.get("RelHomeAlt", math.nan))
        elif name in ("XKF1", "NKF1") and told.get("C", 0) == 0 and "VN" in told:
            self.speed_s.append(t_s)
            self.speed.append((told["VE"], told["VN"], -told["VD"]))
        elif name == "GPS" and told.get("Status", 0) >= _LEAST_FIX and told.get("GWk", 0) > 0:
            self.utc.append((t_s, gps_time_utc_s(told["GWk"], told["GMS"])))
        elif name == "GPA" and told.get("I", 0) == 0 and "HAcc" in told:
            self.accuracy.append(told["HAcc"])
        elif name == "MNT" and told.get("I", 0) == 0 and "YawE" in told:
            self.held_s.append(t_s)
            self.held.append((told["Roll"], told["Pitch"], told["YawE"]))
