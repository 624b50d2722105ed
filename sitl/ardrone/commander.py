"""The flight's state machine: landed, taking off, hovering or flying, landing, emergency.

Source: AR.Drone Developer Guide, SDK 2.0, sections 6.5 to 6.9 (REF, PCMD, FTRIM).
"""

from __future__ import annotations

import math

from sitl.ardrone.aircraft import Aircraft
from sitl.ardrone.at import Pcmd, Ref
from sitl.ardrone.configuration import Configuration
from sitl.ardrone.state import ControlState

TAKE_OFF_HEIGHT_M = 0.9
_TAKE_OFF_CLIMB_M_S = 0.45
_TAKE_OFF_DONE_M = 0.08
_MOTOR_START_S = 1.5
_LAND_M_S = 0.45
_LANDED_S = 0.4
"""On the ground for this long ends a landing."""
_CRASH_TILT_RAD = math.radians(65.0)
_BRAKED_M_S = 0.25
_CLIMB_ZERO = 0.02
"""A gaz below this holds the height."""
_CRITICAL_PERCENT = 3.0
LOW_PERCENT = 20.0


class Commander:
    """Obeys the pilot as far as the state allows, and moves the aircraft."""

    def __init__(
        self, aircraft: Aircraft, configuration: Configuration, battery_percent: float, endurance_s: float
    ) -> None:
        self._aircraft, self._configuration = aircraft, configuration
        self.battery_percent = battery_percent
        self._endurance_s = endurance_s
        self.state = ControlState.LANDED
        self.emergency = False
        self.user_emergency = False
        """The emergency is the pilot's own."""
        self.angles_out_of_range = False
        self.wants_air = False
        """Bit 9 of the last REF."""
        self.trims = 0
        self._emergency_bit = False
        self._pcmd: Pcmd | None = None
        self._since_s = 0.0
        self._grounded_s = 0.0
        self._height_m = TAKE_OFF_HEIGHT_M

    @property
    def battery_low(self) -> bool:
        """Whether the pilot is warned."""
        return self.battery_percent < LOW_PERCENT

    @property
    def wanted_height_m(self) -> float:
        """The height that is held."""
        return self._height_m

    def ref(self, command: Ref) -> None:
        """Take-off, land, emergency."""
        if command.emergency and not self._emergency_bit:
            self._toggle_emergency()
        self._emergency_bit = command.emergency
        self.wants_air = command.take_off
        if self.emergency:
            return
        if command.take_off and self.state is ControlState.LANDED and self.battery_percent > _CRITICAL_PERCENT:
            self._enter(ControlState.TAKING_OFF)
        elif not command.take_off and self.state in (
            ControlState.TAKING_OFF,
            ControlState.FLYING,
            ControlState.HOVERING,
            ControlState.GOING_TO_FIX,
        ):
            self._enter(ControlState.LANDING)

    def pcmd(self, command: Pcmd) -> None:
        """Movement, in force until the next one; not obeyed while taking off or landing."""
        self._pcmd = command

    def flat_trim(self) -> bool:
        """FTRIM; refused in the air."""
        if self.state is not ControlState.LANDED or not self._aircraft.grounded:
            return False
        self._aircraft.sensors.flat_trim()
        self.trims += 1
        return True

    def pilot_lost(self) -> None:
        """Nobody pilots: hover."""
        self._pcmd = None

    def step(self) -> None:
        """Let one step of the aircraft pass."""
        self._since_s += self._aircraft.dt
        if self.state.in_the_air:
            self._drain()
        if self.state.in_the_air and self._aircraft.true_tilt_rad > _CRASH_TILT_RAD:
            self.angles_out_of_range = True
            self._cut()
        match self.state:
            case ControlState.TAKING_OFF:
                self._take_off()
            case ControlState.LANDING:
                self._land()
            case ControlState.FLYING | ControlState.HOVERING | ControlState.GOING_TO_FIX:
                self._fly()
            case _:
                self._aircraft.idle()

    def _toggle_emergency(self) -> None:
        if not self.emergency:
            self.user_emergency = True
            self._cut()
            return
        # An aircraft that lies on its back, or still falls, stays in emergency.
        if self._aircraft.grounded and self._aircraft.true_tilt_rad < _CRASH_TILT_RAD:
            self.emergency = self.user_emergency = self.angles_out_of_range = False

    def _cut(self) -> None:
        self.emergency = True
        self._enter(ControlState.LANDED)

    def _drain(self) -> None:
        self.battery_percent = max(0.0, self.battery_percent - 100.0 * self._aircraft.dt / self._endurance_s)
        if self.battery_percent <= _CRITICAL_PERCENT and self.state is not ControlState.LANDING:
            self._enter(ControlState.LANDING)

    def _enter(self, state: ControlState) -> None:
        self.state, self._since_s, self._grounded_s = state, 0.0, 0.0

    def _take_off(self) -> None:
        if self._since_s < _MOTOR_START_S:
            self._aircraft.idle()
            return
        left_m = TAKE_OFF_HEIGHT_M - self._aircraft.estimate.position[2]
        if left_m < _TAKE_OFF_DONE_M:
            self._height_m = TAKE_OFF_HEIGHT_M
            self._pcmd = None
            self._enter(ControlState.HOVERING)
        self._aircraft.hover(height_m=None, climb_m_s=min(_TAKE_OFF_CLIMB_M_S, max(0.15, left_m)))

    def _land(self) -> None:
        self._aircraft.hover(height_m=None, climb_m_s=-_LAND_M_S)
        self._grounded_s = self._grounded_s + self._aircraft.dt if self._aircraft.grounded else 0.0
        if self._grounded_s > _LANDED_S:
            self._enter(ControlState.LANDED)

    def _fly(self) -> None:
        command = self._pcmd
        climb, turn = self._vertical(command), 0.0
        if command is not None:
            turn = command.yaw * self._configuration.number("control:control_yaw")
        height = self._height_m if climb is None else None
        if command is None or not command.progressive:
            braked = math.hypot(*self._aircraft.flow) < _BRAKED_M_S
            if self.state is ControlState.FLYING:
                self._enter(ControlState.GOING_TO_FIX)
            if self.state is ControlState.GOING_TO_FIX and braked:
                self._enter(ControlState.HOVERING)
            # Without the progressive bit all else in the command is ignored (section 6.6).
            self._aircraft.hover(height_m=self._height_m)
            return
        if self.state is not ControlState.FLYING:
            self._enter(ControlState.FLYING)
        roll, pitch = self._tilts(command)
        self._aircraft.tilt(roll, pitch, height_m=height, climb_m_s=climb or 0.0, yaw_rate_rad_s=turn)

    def _vertical(self, command: Pcmd | None) -> float | None:
        """The climb rate to follow; None to hold the height, which follows the climb."""
        if command is None or not command.progressive or abs(command.gaz) < _CLIMB_ZERO:
            return None
        height = self._aircraft.estimate.position[2]
        low = self._configuration.number("control:altitude_min") / 1000.0
        high = self._configuration.number("control:altitude_max") / 1000.0
        climb = command.gaz * self._configuration.number("control:control_vz_max") / 1000.0
        self._height_m = min(high, max(low, height))
        if (climb > 0.0 and height >= high) or (climb < 0.0 and height <= max(low, 0.3)):
            return None
        return climb

    def _tilts(self, command: Pcmd) -> tuple[float, float]:
        most = self._configuration.number("control:euler_angle_max")
        roll, pitch = command.roll * most, command.pitch * most
        if command.absolute and command.psi is not None:
            # Along the pilot's heading: turned by how far the nose stands from it.
            away = self._aircraft.euler[2] - command.psi * math.pi
            s, c = math.sin(away), math.cos(away)
            roll, pitch = roll * c + pitch * s, pitch * c - roll * s
        return roll, pitch
