"""Configuring the drone: one key after the other, each acknowledged (AR.Drone SDK 2.0, Developer Guide 8).

A key is sent until navdata's state shows the command acknowledgement; then AT*CTRL with ACKNOWLEDGE is sent until that
bit is down again, and only then the next key. Before each AT*CONFIG goes the AT*CONFIG_IDS of our session, so that
another application's settings come back when we are gone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from mission.vehicle.ardrone.at import AtCommand, CtrlMode, config, config_ids, ctrl
from mission.vehicle.ardrone.navdata import DroneState, Navdata
from mission.vehicle.ardrone.navdata_options import MASK

SEND_AGAIN_S = 0.12
PATIENCE_S = 4.0
"""A key that is not acknowledged within this time is given up."""


@dataclass(frozen=True, slots=True)
class ConfigSession:
    """Three identifiers of eight hexadecimal digits, which the drone keeps settings under."""

    session: str
    profile: str
    application: str


@dataclass(frozen=True, slots=True)
class FlightConfig:
    """How the drone shall fly; the shares of AT*PCMD are of these."""

    euler_angle_max_rad: float = 0.25
    control_vz_max_m_s: float = 1.0
    control_yaw_rad_s: float = 1.75
    altitude_max_m: float = 30.0
    outdoor: bool = False
    codec: int = 0x81
    max_bitrate_kbit_s: int = 4000
    """video:max_bitrate, with bitrate_ctrl_mode 1 (dynamic; the Developer Guide calls it bitrate_control_mode, the
    aircraft does not know that name)."""
    camera: Literal["front", "below"] = "front"

    def entries(self) -> list[tuple[str, str]]:
        """Category:name and value, in the order in which they are set."""
        return [
            ("general:navdata_demo", "FALSE"),
            ("general:navdata_options", str(MASK)),
            ("video:video_channel", "0" if self.camera == "front" else "1"),
            ("video:bitrate_ctrl_mode", "1"),
            ("video:max_bitrate", str(self.max_bitrate_kbit_s)),
            ("video:video_codec", str(self.codec)),
            ("control:outdoor", "TRUE" if self.outdoor else "FALSE"),
            ("control:altitude_max", str(round(1000 * self.altitude_max_m))),
            ("control:control_vz_max", str(round(1000 * self.control_vz_max_m_s))),
            ("control:control_yaw", f"{self.control_yaw_rad_s:.4f}"),
            ("control:euler_angle_max", f"{self.euler_angle_max_rad:.4f}"),
        ]


class ConfigDialogue:
    """The keys that are still to be set, and the one that is being set.

    Args:
        session: whose settings these are.
        keys: to begin with, after those of the session itself.
    """

    def __init__(self, session: ConfigSession, keys: Iterable[tuple[str, str]]) -> None:
        self._session = session
        own = (
            ("custom:session_id", session.session),
            ("custom:profile_id", session.profile),
            ("custom:application_id", session.application),
        )
        self._waiting: deque[tuple[str, str]] = deque((*own, *keys))
        self._current: tuple[str, str] | None = None
        self._began_s = 0.0
        self._sent_s: float | None = None
        self._confirmed = False
        self.given_up: list[str] = []
        """Keys that the drone never acknowledged."""

    @property
    def done(self) -> bool:
        """Whether nothing is left to be set."""
        return self._current is None and not self._waiting

    def set(self, key: str, value: str) -> None:
        """One more key."""
        self._waiting.append((key, value))

    def step(self, state: Navdata, now_s: float) -> list[AtCommand]:
        """What to send now, given the newest navdata."""
        acknowledged = state.says(DroneState.COMMAND_ACK)
        if self._current is not None:
            if self._confirmed and not acknowledged:
                self._current = None
            elif acknowledged and self._sent_s is not None and not self._confirmed:
                self._confirmed, self._sent_s = True, None
            elif now_s - self._began_s > PATIENCE_S:
                if not self._confirmed:
                    self.given_up.append(self._current[0])
                self._current = None
        if self._current is None and self._waiting:
            # An old acknowledgement is cleared first: it would be taken for that of this key.
            if acknowledged:
                return self._paced(now_s, [ctrl(CtrlMode.ACKNOWLEDGE)])
            self._current = self._waiting.popleft()
            self._began_s, self._sent_s, self._confirmed = now_s, None, False
        if self._current is None:
            return []
        if self._confirmed:
            return self._paced(now_s, [ctrl(CtrlMode.ACKNOWLEDGE)])
        ids = config_ids(self._session.session, self._session.profile, self._session.application)
        return self._paced(now_s, [ids, config(*self._current)])

    def _paced(self, now_s: float, commands: list[AtCommand]) -> list[AtCommand]:
        if self._sent_s is not None and now_s - self._sent_s < SEND_AGAIN_S:
            return []
        self._sent_s = now_s
        return commands
