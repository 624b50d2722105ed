"""The aircraft's configuration: keys, their categories, and the multi-configuration rule (SDK 2.0, chapter 8).

A key belongs to everybody (common), or to an application, a user or a session. As long as no identifier is set, any
CONFIG is obeyed. Once one is, a CONFIG of these three categories must be announced by a CONFIG_IDS with the identifiers
in force, or nothing happens: that is how a forgotten second program cannot change the flight.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Category = Literal["common", "application", "user", "session"]
_Kind = Literal["int", "float", "bool", "text"]

NO_ID = "00000000"
DEFAULT_EULER_ANGLE_MAX_RAD = math.radians(12.0)

H264_360P = 0x81
H264_720P = 0x83
_CODECS_720P = (0x82, H264_720P, 0x86)


@dataclass(frozen=True, slots=True)
class _Key:
    category: Category
    kind: _Kind
    default: str
    writable: bool = True
    low: float = -math.inf
    high: float = math.inf


def _key(
    category: Category,
    kind: _Kind,
    default: str,
    *,
    writable: bool = True,
    low: float = -math.inf,
    high: float = math.inf,
) -> _Key:
    return _Key(category, kind, default, writable, low, high)


KEYS: dict[str, _Key] = {
    "general:num_version_config": _key("common", "int", "1", writable=False),
    "general:num_version_mb": _key("common", "int", "33", writable=False),
    "general:num_version_soft": _key("common", "text", "2.4.8", writable=False),
    "general:drone_serial": _key("common", "text", "SIDESTEPSIM00000", writable=False),
    "general:ardrone_name": _key("common", "text", "My ARDrone"),
    "general:flying_time": _key("common", "int", "0", writable=False),
    "general:navdata_demo": _key("common", "bool", "FALSE"),
    "general:navdata_options": _key("application", "int", "65537", low=0, high=2**32 - 1),
    "general:com_watchdog": _key("common", "int", "2", writable=False),
    "general:video_enable": _key("common", "bool", "TRUE"),
    "general:vision_enable": _key("common", "bool", "TRUE"),
    "general:vbat_min": _key("common", "int", "9000", writable=False),
    "control:euler_angle_max": _key("user", "float", f"{DEFAULT_EULER_ANGLE_MAX_RAD:.7e}", low=0.0, high=0.52),
    "control:altitude_max": _key("common", "int", "3000", low=500, high=100000),
    "control:altitude_min": _key("common", "int", "50", low=50, high=5000),
    "control:control_vz_max": _key("user", "float", "7.0000000e+02", low=200.0, high=2000.0),
    "control:control_yaw": _key("user", "float", "1.7453293e+00", low=0.7, high=6.11),
    "control:control_iphone_tilt": _key("user", "float", "3.4906584e-01"),
    "control:control_level": _key("application", "int", "0"),
    "control:outdoor": _key("common", "bool", "FALSE"),
    "control:flight_without_shell": _key("common", "bool", "FALSE"),
    "control:flying_mode": _key("session", "int", "0"),
    "control:hovering_range": _key("session", "int", "1000"),
    "control:flight_anim": _key("common", "text", "0,0"),
    "network:ssid_single_player": _key("common", "text", "ardrone2_sidestep"),
    "network:owner_mac": _key("common", "text", "00:00:00:00:00:00"),
    "network:wifi_rate": _key("common", "int", "0"),
    "pic:ultrasound_freq": _key("common", "int", "8"),
    "pic:ultrasound_watchdog": _key("common", "int", "3", writable=False),
    "pic:pic_version": _key("common", "int", "184877090", writable=False),
    "video:camif_fps": _key("common", "int", "30", writable=False),
    "video:codec_fps": _key("session", "int", "30", low=15, high=30),
    "video:video_codec": _key("session", "int", str(H264_360P)),
    "video:video_slices": _key("application", "int", "0", low=0, high=8),
    "video:video_live_socket": _key("application", "int", "0", low=0, high=1),
    "video:bitrate": _key("application", "int", "1000", low=250, high=4000),
    "video:max_bitrate": _key("session", "int", "4000", low=250, high=20000),
    "video:bitrate_ctrl_mode": _key("application", "int", "0", low=0, high=2),
    "video:bitrate_storage": _key("application", "int", "4000"),
    "video:video_channel": _key("session", "int", "0", low=0, high=3),
    "video:video_on_usb": _key("common", "bool", "TRUE"),
    "leds:leds_anim": _key("common", "text", "0,0,0"),
    "detect:detect_type": _key("session", "int", "3"),
    "detect:enemy_colors": _key("common", "int", "1"),
    "detect:detections_select_h": _key("session", "int", "0"),
    "detect:detections_select_v": _key("session", "int", "0"),
    "detect:detections_select_v_hsync": _key("session", "int", "0"),
    "gps:latitude": _key("common", "float", "5.0000000e+02"),
    "gps:longitude": _key("common", "float", "5.0000000e+02"),
    "gps:altitude": _key("common", "float", "0.0000000e+00"),
    "custom:application_id": _key("common", "text", NO_ID),
    "custom:application_desc": _key("common", "text", "Default application configuration"),
    "custom:profile_id": _key("common", "text", NO_ID),
    "custom:profile_desc": _key("common", "text", "Default profile configuration"),
    "custom:session_id": _key("common", "text", NO_ID),
    "custom:session_desc": _key("common", "text", "Default session configuration"),
}
"""What a client may read and set here. The aircraft has more keys, which would have no effect in a simulation."""

_ID_KEYS: dict[str, Category] = {
    "custom:session_id": "session",
    "custom:profile_id": "user",
    "custom:application_id": "application",
}


class Configuration:
    """All values, and whose they are."""

    def __init__(self) -> None:
        self._common = {name: key.default for name, key in KEYS.items() if key.category == "common"}
        self._ids: dict[Category, str] = {"session": NO_ID, "user": NO_ID, "application": NO_ID}
        self._own: dict[tuple[Category, str], dict[str, str]] = {}
        self._announced: tuple[str, str, str] | None = None
        self.changed: list[Callable[[str], None]] = []
        """Called with a key after its value changed."""

    def announce(self, session: str, user: str, application: str) -> None:
        """CONFIG_IDS: for whom the next `set` is."""
        self._announced = (session, user, application)

    def set(self, key: str, value: str) -> bool:
        """CONFIG: change a value; False when the aircraft refuses it."""
        announced, self._announced = self._announced, None
        known = KEYS.get(key)
        if known is None or not known.writable:
            return False
        if known.category != "common" and not self._meant_for_us(announced):
            return False
        clean = _clean(known, value)
        if clean is None:
            return False
        if key in _ID_KEYS:
            if not self._switch(_ID_KEYS[key], clean):
                return False
            for name, its in KEYS.items():
                if its.category == _ID_KEYS[key]:
                    self._tell(name)
        self._values(known.category)[key] = clean
        if key in _ID_KEYS:
            self._common[key] = self._ids[_ID_KEYS[key]]
        self._tell(key)
        return True

    def text(self, key: str) -> str:
        """A value as the aircraft writes it."""
        known = KEYS[key]
        return self._values(known.category).get(key, known.default)

    def number(self, key: str) -> float:
        """A numeric value."""
        return float(self.text(key))

    def flag(self, key: str) -> bool:
        """A boolean value."""
        return self.text(key) == "TRUE"

    @property
    def ids(self) -> tuple[str, str, str]:
        """Session, user and application in force."""
        return self._ids["session"], self._ids["user"], self._ids["application"]

    def listing(self) -> bytes:
        """What the control port sends: a line ``key = value`` for each key, and a zero at the end."""
        return "".join(f"{key} = {self.text(key)}\n" for key in KEYS).encode() + b"\0"

    def custom_listing(self) -> bytes:
        """What the control port sends for mode 6: the identifiers that have values of their own."""
        found: dict[Category, list[str]] = {"application": [], "user": [], "session": []}
        for category, name in self._own:
            if name == NO_ID:
                continue
            found[category].append(name)
        titles: dict[Category, str] = {"application": "applications", "user": "profiles", "session": "sessions"}
        lines = [
            f"[{titles[category]}]\n" + "".join(f"{name}\n" for name in names) for category, names in found.items()
        ]
        return "".join(lines).encode() + b"\0"

    def _meant_for_us(self, announced: tuple[str, str, str] | None) -> bool:
        if announced is None:
            return all(one == NO_ID for one in self._ids.values())
        return announced == self.ids

    def _switch(self, category: Category, name: str) -> bool:
        """Make an identifier the one in force; ``-name`` forgets one, ``-all`` all of them."""
        if name.startswith("-"):
            gone = [key for key in self._own if key[0] == category and name in ("-all", f"-{key[1]}")]
            for key in gone:
                del self._own[key]
            if name == "-all" or name[1:] == self._ids[category]:
                self._ids[category] = NO_ID
            return True
        if len(name) != 8 or any(c not in "0123456789abcdefABCDEF" for c in name):
            return False
        self._ids[category] = name
        if name != NO_ID:
            self._own.setdefault((category, name), {})
        return True

    def _values(self, category: Category) -> dict[str, str]:
        if category == "common":
            return self._common
        return self._own.setdefault((category, self._ids[category]), {})

    def _tell(self, key: str) -> None:
        for listener in self.changed:
            listener(key)


def picture_height(codec: int) -> int:
    """Lines of the live picture for a value of `video:video_codec`: 360 or 720."""
    return 720 if codec in _CODECS_720P else 360


def _clean(key: _Key, value: str) -> str | None:
    """The value as it is stored; None when it is not of the key's kind or outside of its limits."""
    match key.kind:
        case "bool":
            upper = value.strip().upper()
            return {"TRUE": "TRUE", "FALSE": "FALSE", "1": "TRUE", "0": "FALSE"}.get(upper)
        case "text":
            return value if len(value) <= 256 and value.isprintable() else None
        case "int" | "float":
            number = _number(value)
            if number is None or not key.low <= number <= key.high:
                return None
            if key.kind == "int":
                return str(round(number))
            return f"{number:.7e}"


def _number(value: str) -> float | None:
    try:
        number = float(value)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
