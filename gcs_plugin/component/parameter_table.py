"""Which settings are MAVLink parameters, and under what name: the one table, for the link and for people.

A parameter's name has at most 16 characters, so that long names of the settings file are shortened. Not in the table:
addresses, files and folders (no numbers), what is used only at the start, and who may give orders.
"""

from __future__ import annotations

import math
import types
from dataclasses import dataclass
from typing import Final, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pymavlink.dialects.v20 import all as mavlink

from mission.settings import MissionSettings

PARAMETER_NAMES: Final[dict[str, str]] = {
    "video.latency_s": "VIDEO_LATENCY_S",
    "video.check_offset": "VIDEO_CHK_OFFSET",
    "video.open_timeout_s": "VIDEO_OPEN_T_S",
    "camera.hfov_deg": "CAMERA_HFOV_DEG",
    "camera.tilt_down_deg": "CAMERA_TILT_DEG",
    "detect.timeout_s": "DETECT_TIMEOUT_S",
    "pattern.kind": "PATTERN_KIND",
    "pattern.length_m": "PATTERN_LENGTH_M",
    "pattern.leg_duration_s": "PATTERN_LEG_S",
    "pattern.accuracy_percent": "PATTERN_ACC_PCT",
    "pattern.side": "PATTERN_SIDE",
    "pattern.passes": "PATTERN_PASSES",
    "limits.radius_m": "LIMITS_RADIUS_M",
    "limits.min_height_m": "LIMITS_MIN_H_M",
    "limits.max_height_m": "LIMITS_MAX_H_M",
    "limits.max_speed_m_s": "LIMITS_SPEED_M_S",
    "limits.max_duration_s": "LIMITS_TIME_S",
    "prior.speed_sigma_m_s": "PRIOR_SPEED_M_S",
    "prior.vertical_speed_sigma_m_s": "PRIOR_VERT_M_S",
    "prior.acceleration_psd_m2_s3": "PRIOR_ACC_PSD",
    "prior.centre_above_ground_m": "PRIOR_CENTRE_M",
    "answer.roi": "ANSWER_ROI",
    "answer.waypoint": "ANSWER_WAYPOINT",
    "answer.standoff_m": "ANSWER_STANDOFF",
    "answer.statustext": "ANSWER_TEXT",
    "answer.adsb_lifetime_s": "ANSWER_ADSB_S",
    "orders.box": "ORDERS_BOX",
    "repeat": "REPEAT",
}
"""Setting, as in the TOML file (section.name), to parameter."""

NOT_PARAMETERS: Final = frozenset(
    {
        "link.url",
        "link.system",
        "link.connect_timeout_s",
        "link.min_battery",
        "link.release",
        "link.accept_failsafe",
        "link.compass_sigma_deg",
        "video.url",
        "video.keep_open_s",
        "camera.file",
        "camera.ignore_gimbal",
        "detect.detector",
        "pattern.baseline_m",
        # Given in pairs, and a parameter is set alone.
        "prior.ground_above_take_off_m",
        "prior.ground_sigma_m",
        "prior.height_m",
        "prior.height_sigma_m",
        "prior.class_height",
        "answer.folder",
        "answer.adsb_url",
        "orders.component",
        "orders.video_url",
        "record.video",
        "record.max_mb",
    }
)
"""Settings that are none; nor is any of [authority], [tak] and [console]."""

TIGHTENED_ONLY: Final[dict[str, Literal["at most", "at least"]]] = {
    "limits.radius_m": "at most",
    "limits.min_height_m": "at least",
    "limits.max_height_m": "at most",
    "limits.max_speed_m_s": "at most",
    "limits.max_duration_s": "at most",
}
"""Safety limits: what the settings file says is a ceiling (or a floor), and a station may only ask for less room."""

Value = float | int | bool | str | None


@dataclass(frozen=True, slots=True)
class Parameter:
    """One setting as a parameter."""

    name: str
    setting: str
    type: int
    """MAV_PARAM_TYPE: REAL32, INT32, or UINT8 for a switch or a choice."""
    choices: tuple[str, ...] = ()
    """What the numbers 0, 1, ... of a choice mean."""
    optional: bool = False
    """Whether NaN stands for "not set"."""

    def read(self, settings: MissionSettings) -> float:
        """The setting as a number."""
        value = _get(settings, self.setting)
        if value is None:
            return math.nan
        if isinstance(value, str):
            # A choice that came with a newer settings file than this table would be shown as the first one.
            return float(self.choices.index(value)) if value in self.choices else 0.0
        return float(value)

    def changed(self, settings: MissionSettings, number: float) -> MissionSettings | None:
        """The settings with this number in them; None when they do not take it.

        Args:
            settings: as they are.
            number: any float.
        """
        value: Value
        if self.optional and math.isnan(number):
            value = None
        elif not math.isfinite(number):
            return None
        elif self.type == mavlink.MAV_PARAM_TYPE_REAL32:
            value = _shortest(number)
        elif number != int(number):
            return None
        elif self.choices:
            if not 0 <= number < len(self.choices):
                return None
            value = self.choices[int(number)]
        elif self.type == mavlink.MAV_PARAM_TYPE_UINT8:
            if number not in (0.0, 1.0):
                return None
            value = bool(number)
        else:
            value = int(number)
        try:
            return MissionSettings.model_validate(_put(settings, self.setting, value))
        except ValidationError:
            return None


def wider_than(parameter: Parameter, settings: MissionSettings, file: MissionSettings) -> str | None:
    """Why a changed setting is not taken: it would give a flight more room than the settings file does.

    Args:
        parameter: that was changed.
        settings: with the change.
        file: the settings file's.
    """
    bound = TIGHTENED_ONLY.get(parameter.setting)
    wanted, allowed = parameter.read(settings), parameter.read(file)
    if bound is None or wanted == allowed or (wanted < allowed) == (bound == "at most"):
        return None
    return f"{parameter.name} stays: the settings file allows {bound} {allowed:g}"


def parameters() -> tuple[Parameter, ...]:
    """All parameters, by name."""
    return tuple(sorted((_parameter(s, n) for s, n in PARAMETER_NAMES.items()), key=lambda p: p.name))


def table_lines() -> list[str]:
    """The table for people: parameter, setting, and what its numbers mean."""
    lines = [f"{'parameter':<16}  {'setting':<31}  values"]
    for p in parameters():
        if p.choices:
            values = ", ".join(f"{i} {choice}" for i, choice in enumerate(p.choices))
        elif p.type == mavlink.MAV_PARAM_TYPE_UINT8:
            values = "0 off, 1 on"
        else:
            values = "whole number" if p.type == mavlink.MAV_PARAM_TYPE_INT32 else "number"
            values += ", NaN for none" if p.optional else ""
        lines.append(f"{p.name:<16}  {p.setting:<31}  {values}")
    return lines


def _parameter(setting: str, name: str) -> Parameter:
    annotation = _annotation(setting)
    members = get_args(annotation)
    optional = get_origin(annotation) in (Union, types.UnionType) and type(None) in members
    if get_origin(annotation) is Literal:
        return Parameter(name, setting, mavlink.MAV_PARAM_TYPE_UINT8, tuple(str(m) for m in members))
    if annotation is bool:
        return Parameter(name, setting, mavlink.MAV_PARAM_TYPE_UINT8)
    if annotation is int:
        return Parameter(name, setting, mavlink.MAV_PARAM_TYPE_INT32)
    return Parameter(name, setting, mavlink.MAV_PARAM_TYPE_REAL32, optional=optional)


def _annotation(setting: str) -> object:
    model: type[BaseModel] = MissionSettings
    *sections, name = setting.split(".")
    for section in sections:
        model = type(model.model_fields[section].default)
    return model.model_fields[name].annotation


def _get(settings: MissionSettings, setting: str) -> Value:
    value: object = settings
    for part in setting.split("."):
        value = getattr(value, part)
    return value if isinstance(value, float | int | str) else None


def _put(settings: MissionSettings, setting: str, value: Value) -> dict[str, object]:
    """The settings as a nested dictionary, with one value changed: to be validated again as a whole."""
    content: dict[str, object] = settings.model_dump()
    inner = content
    *sections, name = setting.split(".")
    for section in sections:
        deeper = inner[section]
        if not isinstance(deeper, dict):
            raise TypeError(f"{section} is not a section")
        inner = deeper
    inner[name] = value
    return content


def _shortest(number: float) -> float:
    """The shortest decimal that is this 32-bit float: 0.2, not 0.20000000298."""
    return float(f"{number:.7g}")
