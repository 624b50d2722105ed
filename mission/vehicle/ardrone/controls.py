"""What the pilot's rules order of an AR.Drone, as AT commands: `mission.vehicle.pilot.controls.Controls`.

Nothing is repeated longer than it must be, so that somebody else's command stays: AT*REF only until the drone shows
that it obeyed, AT*PCMD only while we fly it and for a moment of hover afterwards. In between the link is kept with
AT*COMWDG (the drone hovers by itself when it hears nothing for 2 s, and says so after 50 ms).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np

from mission.vehicle.ardrone.at import AtCommand, Tilt, clamped, comwdg, ftrim, pcmd, ref
from mission.vehicle.ardrone.config import FlightConfig
from mission.vehicle.ardrone.navdata import DroneState
from mission.vehicle.ardrone.navdata_options import Control
from mission.vehicle.ardrone.tilt import HEIGHT_GAIN, TiltControl
from mission.vehicle.ardrone.vehicle import GROUNDED, ArdroneVehicle
from mission.vehicle.path_follower import Setpoint
from mission.vehicle.pilot.controls import Answer, Ordered
from mission.vehicle.state.modes import ModeKind

STALE_SETPOINT_S = 0.3
"""A setpoint that is older is not flown any more: hover."""
STALE_NAVDATA_S = 0.4
"""Without a position that is younger we do not tilt: hover."""
_HOVER_S = 1.0
_REACHED_M = 0.15
_AT_REST_M = 0.35
_LEAVES_REST_M = 0.7
_FACING_RAD = 0.02
_LEAVES_FACING_RAD = 0.05
_SLOW_M_S = 0.25
_TEXT_S = 3.0
_RESET_AGAIN_S = 0.7


class ArdroneControls:
    """Turns orders into the AT commands of each tick.

    Args:
        vehicle: what the drone reports; told here what we do with it.
        config: how the drone was configured.
        clock: program time.
    """

    def __init__(
        self, vehicle: ArdroneVehicle, config: FlightConfig, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._vehicle = vehicle
        self._config = config
        self._clock = clock
        self._lock = threading.RLock()
        self._setpoint: tuple[float, Setpoint, float] | None = None
        self._tilt = TiltControl(config)
        self._resting = False
        self._height_m = 1.0
        self._hover_until_s = 0.0
        self._trim = False
        self._reset_s = 0.0
        self._started = False

    def setpoint(self, setpoint: Setpoint, yaw_rad: float) -> None:
        """Where to be, how fast, and the heading; flown in the mode for it, for as long as it is fresh."""
        with self._lock:
            now = self._clock()
            self._setpoint = (now, setpoint, yaw_rad)
            self._tilt.feed(setpoint, now)

    def release(self) -> None:
        """Leave it alone; one hover command takes our last tilt back."""
        with self._lock:
            self._setpoint = None
            self._vehicle.doing = None
            self._hover_until_s = self._clock()

    def ask_mode(self, kind: ModeKind, attempt: int) -> None:
        """Fly setpoints from now on, hover on the drone's own, or land; another mode there is not."""
        del attempt
        with self._lock:
            if kind == "offboard":
                self._tilt = TiltControl(self._config)
            elif kind == "hold":
                self._setpoint = None
                self._hover_until_s = self._clock() + _HOVER_S
            if kind in ("offboard", "hold", "land"):
                self._vehicle.doing = kind

    def arm(self, attempt: int) -> None:
        """Tell the drone that it stands level, and that it may take off; an old emergency is reset."""
        del attempt
        with self._lock:
            self._trim = True
            self._vehicle.readied = True

    def take_off(self, height_m: float, attempt: int) -> None:
        """Take off and climb to a height above the ground."""
        del attempt
        with self._lock:
            self._height_m, self._started = height_m, False
            self._vehicle.doing = "take-off"

    def answer(self, order: Ordered, since_s: float) -> Answer:
        """There are no answers: what is ordered is done at each tick until the drone shows that it obeyed."""
        del order, since_s
        return "accepted"

    def complaint(self) -> str:
        """What the drone last said, if that was just now."""
        now = self._clock()
        said = [text for t_s, _, text in list(self._vehicle.texts) if now - t_s < _TEXT_S]
        return said[-1] if said else ""

    def commands(self, now_s: float) -> list[AtCommand]:
        """What to send in this tick, at least AT*COMWDG."""
        with self._lock:
            commands = self._link(now_s)
            doing = self._vehicle.doing
            if doing == "offboard":
                commands.append(pcmd(self._flown(now_s)))
            elif doing == "take-off":
                commands.append(self._climb(now_s))
            elif doing == "land":
                commands.append(self._land())
            elif self._hover_until_s:
                commands.append(pcmd(None))
                if now_s >= self._hover_until_s:
                    self._hover_until_s = 0.0
            return commands

    def _link(self, now_s: float) -> list[AtCommand]:
        navdata = self._vehicle.navdata
        commands = [comwdg()]
        grounded = self._vehicle.control in GROUNDED
        if self._trim and grounded:
            if navdata is not None and navdata.says(DroneState.EMERGENCY):
                # Once, and the bit down again: whether the drone acts on the bit or on its rise, it toggles.
                if now_s - self._reset_s > _RESET_AGAIN_S:
                    self._reset_s = now_s
                    commands += [ref(fly=False, emergency=True), ref(fly=False)]
            else:
                commands.append(ftrim())
                self._trim = False
        return commands

    def _flown(self, now_s: float) -> Tilt | None:
        local = self._vehicle.local
        if self._setpoint is None or local is None:
            return None
        sent_s, setpoint, yaw_rad = self._setpoint
        if now_s - sent_s > STALE_SETPOINT_S or now_s - local.t_s > STALE_NAVDATA_S:
            return None
        tilt = self._tilt.tilt(setpoint, yaw_rad, local, self._vehicle.yaw_rad, now_s)
        off = float(np.linalg.norm(setpoint.position_ned_m - local.position_ned_m))
        turned = abs(tilt.yaw) * self._config.control_yaw_rad_s
        at_rest = float(np.linalg.norm(setpoint.velocity_ned_m_s)) == 0.0
        if self._resting:
            self._resting = at_rest and off < _LEAVES_REST_M and turned < 2.5 * _LEAVES_FACING_RAD
        else:
            slow = float(np.linalg.norm(local.velocity_ned_m_s)) < _SLOW_M_S
            self._resting = at_rest and slow and off < _AT_REST_M and turned < 2.5 * _FACING_RAD
        # At rest the drone's own hover, which looks at the ground, is steadier than anything from here.
        return None if self._resting else tilt

    def _climb(self, now_s: float) -> AtCommand:
        control, height = self._vehicle.control, self._vehicle.height_m
        if control in GROUNDED and not self._started:
            return ref(fly=True)
        self._started = True
        if control == Control.TAKING_OFF or height is None:
            return pcmd(None)
        missing = self._height_m - height
        if abs(missing) < _REACHED_M or control in GROUNDED:
            self.ask_mode("hold", 0)
            return pcmd(None)
        return pcmd(Tilt(gaz=clamped(HEIGHT_GAIN * missing / self._config.control_vz_max_m_s)))

    def _land(self) -> AtCommand:
        if self._vehicle.control in GROUNDED:
            self._vehicle.doing = None
            return comwdg()
        return ref(fly=False)
