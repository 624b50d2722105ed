"""Arming, flight modes, landing detection and failsafes: what PX4 calls its commander."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import IntEnum

from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flavour import Flavour, Mode
from sitl.autopilot.flight_controller import Demand, EstimatedState
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.rotation import Vec

ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
REJECTED: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: int = mavlink.MAV_RESULT_DENIED
UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED
FAILED: int = mavlink.MAV_RESULT_FAILED

_NEWEST_SETPOINT_S = 0.5
"""PX4 enters Offboard only while setpoints come at 2 Hz or more."""
_CONTACT_S = 0.7


class Landed(IntEnum):
    """EXTENDED_SYS_STATE.landed_state."""

    ON_GROUND = mavlink.MAV_LANDED_STATE_ON_GROUND
    IN_AIR = mavlink.MAV_LANDED_STATE_IN_AIR
    TAKEOFF = mavlink.MAV_LANDED_STATE_TAKEOFF
    LANDING = mavlink.MAV_LANDED_STATE_LANDING


@dataclass(frozen=True, slots=True)
class CommandedSetpoint:
    """What a companion asked for, and when."""

    demand: Demand
    t_s: float


class Commander:
    """The state that the heartbeat shows, and the rules by which it changes. Times are the program's, seconds."""

    def __init__(self, config: AutopilotConfig, flavour: Flavour, parameters: Parameters, now: float) -> None:
        self.config, self.flavour, self.parameters = config, flavour, parameters
        self.mode = flavour.start_mode
        self.mode_changes = 0
        self.armed = False
        self.armed_at = now
        self.landed = True
        self.taking_off = False
        self.takeoff_height: float | None = None
        """ENU up of the target while and after taking off."""
        self.setpoint: CommandedSetpoint | None = None
        self.roi: Vec | None = None
        """ENU; where the nose shall point."""
        self.home: Vec = (0.0, 0.0, 0.0)
        """As estimated, ENU; GLOBAL_POSITION_INT.relative_alt counts from its height."""
        self.battery_fraction = config.battery_fraction
        self.has_mission = False
        self.failsafe = False
        self.without_sticks = False
        """In a mode of the pilot's (PX4's Position) with nobody at the sticks: it comes down level, and drifts."""
        self.texts: deque[tuple[int, str]] = deque(maxlen=50)
        self._ready_at = now + config.ready_after_s
        self._announced = self._battery_low = self._outside = False
        self._contact_s = 0.0
        self._landed_at = now
        self.air_at: float | None = None

    @property
    def landed_state(self) -> Landed:
        """What EXTENDED_SYS_STATE says."""
        if self.landed:
            return Landed.ON_GROUND
        if self.mode is Mode.LAND:
            return Landed.LANDING
        return Landed.TAKEOFF if self.taking_off else Landed.IN_AIR

    def ready(self, now: float) -> bool:
        """Whether the position estimate is good enough to arm and fly on."""
        return now >= self._ready_at

    def say(self, text: str, severity: int = mavlink.MAV_SEVERITY_INFO) -> None:
        """A STATUSTEXT for every link; PX4 ends its own with a tab."""
        self.texts.append((severity, text + ("\t" if self.flavour.name == "px4" else "")))

    def arm(self, now: float, state: EstimatedState, force: bool = False) -> int:
        """Start the motors."""
        if self.armed:
            return ACCEPTED
        needs_position = self.mode is not Mode.STABILIZE  # ArduPilot arms in STABILIZE before GPS is good
        if needs_position and not self.ready(now) and not force:
            ardupilot = self.flavour.name == "ardupilot"
            self.say("Arm: Need Position Estimate" if ardupilot else "Preflight Fail: no position")
            return FAILED if ardupilot else REJECTED
        if self.flavour.name == "ardupilot" and self.mode in (Mode.LAND, Mode.RTL, Mode.BRAKE):
            self.say("Arm: Mode not armable")
            return FAILED
        self.armed, self.armed_at, self.home = True, now, state.position
        self.say("Arming motors" if self.flavour.name == "ardupilot" else "Armed by external command")
        return ACCEPTED

    def disarm(self, force: bool, why: str = "Disarmed by external command") -> int:
        """Stop the motors; in the air only by force."""
        if not self.armed:
            return ACCEPTED
        if not self.landed and not force:
            return FAILED if self.flavour.name == "ardupilot" else DENIED
        self.armed, self.taking_off, self.failsafe = False, False, False
        after = Mode.OFFBOARD if self.without_sticks else Mode.HOLD
        self.say("Disarming motors" if self.flavour.name == "ardupilot" else why)
        if self.flavour.name == "px4" and self.mode is not after:
            self._enter(after)
        return ACCEPTED

    def request_mode(self, mode: Mode, now: float) -> int:
        """A mode change ordered over MAVLink or with the pilot's switch; the answer is not the truth (see Position)."""
        refused = FAILED if self.flavour.name == "ardupilot" else REJECTED
        if mode not in self.flavour.modes:
            return refused
        if mode is not Mode.STABILIZE and not self.ready(now):
            return refused
        if mode is Mode.STABILIZE and not self.landed and not self.config.rc:
            return refused
        if mode is Mode.MISSION and not self.has_mission:
            return refused
        if mode is Mode.OFFBOARD and self.flavour.name == "px4":
            if self.setpoint is None or now - self.setpoint.t_s > _NEWEST_SETPOINT_S:
                return refused
        elif mode is Mode.OFFBOARD:
            self.setpoint = None  # GUIDED starts by stopping
        if mode is Mode.POSITION and self.flavour.name == "px4" and not self.config.rc:
            return ACCEPTED  # a real one acknowledges and stays where it was
        self.failsafe = False
        self._enter(mode)
        return ACCEPTED

    def take_off(self, height: float) -> int:
        """Climb to an ENU height (an order already checked for sense)."""
        if self.flavour.name == "ardupilot" and not (self.armed and self.mode is Mode.OFFBOARD and self.landed):
            return FAILED
        if self.flavour.name == "px4":
            self._enter(Mode.TAKEOFF)
        self.takeoff_height, self.setpoint = height, None
        self.taking_off = True
        self.mode_changes += 1
        return ACCEPTED

    def set_setpoint(self, demand: Demand, now: float) -> None:
        """A setpoint came; it is followed in OFFBOARD only, where it also ends a take-off."""
        self.setpoint = CommandedSetpoint(demand, now)
        if self.mode is Mode.OFFBOARD and not self.landed:
            self.taking_off = False
            if self.flavour.name == "ardupilot" and (demand.yaw is not None or demand.yaw_rate is not None):
                self.roi = None

    def step(self, now: float, dt: float, state: EstimatedState, grounded: bool, demand: Demand | None) -> None:
        """Watch over the flight."""
        if not self._announced and self.ready(now):
            self._announced = True
            ardupilot = self.flavour.name == "ardupilot"
            self.say("EKF3 IMU0 is using GPS" if ardupilot else "Ready for takeoff!")
        if self.armed:
            self._watch_ground(now, dt, grounded, demand)
            self._watch_takeoff(state)
            self._watch_setpoints(now)
            self._watch_battery(dt)
            self._watch_fence(state)

    def lift_off(self, now: float) -> None:
        """The navigator saw the aircraft (or PX4's land detector: the thrust) leave the ground."""
        if self.landed:
            self.landed, self.air_at = False, now
            if self.flavour.name == "px4":
                self.say("Takeoff detected")

    def fail_safe(self, mode: Mode, why: str) -> None:
        """Change the mode without being asked."""
        self.failsafe = True
        self.say(f"Failsafe activated: {why}", mavlink.MAV_SEVERITY_CRITICAL)
        self._enter(mode)

    def _enter(self, mode: Mode) -> None:
        if mode is not self.mode:
            self.taking_off = False
            if mode is not Mode.HOLD:
                self.takeoff_height = None
        self.mode = mode
        self.without_sticks = False
        self.mode_changes += 1
        # Either forgets where to look: PX4 when a mission begins, ArduPilot with the next setpoint.
        if mode is Mode.MISSION and self.flavour.name == "px4":
            self.roi = None
        if mode is Mode.LAND and self.flavour.name == "px4":
            self.say("Landing at current position")

    def _watch_ground(self, now: float, dt: float, grounded: bool, demand: Demand | None) -> None:
        descending = demand is not None and (demand.velocity[2] or 0.0) < -0.05
        pressed = grounded and not self.landed and (descending or self.mode in (Mode.LAND, Mode.RTL))
        self._contact_s = self._contact_s + dt if pressed else 0.0
        if self._contact_s > _CONTACT_S:
            self.landed, self.taking_off, self._landed_at, self._contact_s = True, False, now, 0.0
            self.say("Landing detected" if self.flavour.name == "px4" else "SIM Hit ground at 0.5 m/s")
        if self.landed:
            rested = now - self._landed_at > self.flavour.landing_wait_s
            if (
                (self.mode in (Mode.LAND, Mode.RTL) or self.without_sticks)
                and rested
                and self.armed_at < self._landed_at
            ):
                self.disarm(force=False, why="Disarmed by landing")
                return
            name = "COM_DISARM_PRFLT" if self.flavour.name == "px4" else "DISARM_DELAY"
            idle = now - max(self.armed_at, self._landed_at) > self.parameters.number(name)
            if idle and not self.taking_off and demand is None:
                self.disarm(force=False, why="Disarmed by auto preflight disarming")

    def _watch_takeoff(self, state: EstimatedState) -> None:
        if not self.taking_off or self.takeoff_height is None or self.landed:
            return
        missing = self.takeoff_height - state.position[2]
        if self.flavour.name == "px4" and missing < 0.8:  # NAV_MC_ALT_RAD: Hold goes on climbing
            self._enter(Mode.HOLD)
        elif self.flavour.name == "ardupilot" and missing < 0.1:
            self.taking_off = False

    def _watch_setpoints(self, now: float) -> None:
        if self.flavour.name != "px4" or self.mode is not Mode.OFFBOARD or self.setpoint is None or not self.armed:
            return
        if now - self.setpoint.t_s <= self.parameters.number("COM_OF_LOSS_T"):
            return
        action = int(self.parameters.number("COM_OBL_RC_ACT"))
        if action == 5 or (action == 0 and self.config.rc):
            self.fail_safe(Mode.HOLD, "offboard control lost, holding")
        elif action == 3:
            self.fail_safe(Mode.RTL, "offboard control lost, returning")
        elif action == 4:
            self.fail_safe(Mode.LAND, "offboard control lost, landing")
        else:  # 0 to 2 need sticks, and nobody is there
            self.fail_safe(Mode.POSITION, "offboard control lost")
            self.without_sticks = True

    def _watch_battery(self, dt: float) -> None:
        if not self.landed:
            self.battery_fraction = max(0.0, self.battery_fraction - dt / self.config.battery_endurance_s)
        px4 = self.flavour.name == "px4"
        low = self.battery_fraction < self.parameters.number("BAT_LOW_THR" if px4 else "BATT_LOW_FRACTION")
        if low and not self._battery_low:
            action = int(self.parameters.number("COM_LOW_BAT_ACT" if px4 else "BATT_FS_LOW_ACT"))
            lands, returns = ((2, 3), (1,)) if px4 else ((1,), (2,))
            if self.landed or action not in lands + returns:
                self.say("Low battery level" if px4 else "Battery 1 is low", mavlink.MAV_SEVERITY_WARNING)
            else:
                self.fail_safe(Mode.LAND if action in lands else Mode.RTL, "low battery")
        self._battery_low = low

    def _watch_fence(self, state: EstimatedState) -> None:
        px4 = self.flavour.name == "px4"
        if not px4 and not self.parameters.number("FENCE_ENABLE"):
            return
        radius = self.parameters.number("GF_MAX_HOR_DIST" if px4 else "FENCE_RADIUS")
        ceiling = self.parameters.number("GF_MAX_VER_DIST" if px4 else "FENCE_ALT_MAX")
        distance = math.dist(state.position[:2], self.home[:2])
        height = state.position[2] - self.home[2]
        outside = (0.0 < radius < distance) or (0.0 < ceiling < height)
        if outside and not self._outside and not self.landed:
            action = int(self.parameters.number("GF_ACTION" if px4 else "FENCE_ACTION"))
            reactions = {2: Mode.HOLD, 3: Mode.RTL, 5: Mode.LAND} if px4 else {1: Mode.RTL, 2: Mode.LAND, 4: Mode.BRAKE}
            if action in reactions:
                self.fail_safe(reactions[action], "geofence breached")
            else:
                self.say("Geofence breached", mavlink.MAV_SEVERITY_WARNING)
        self._outside = outside
