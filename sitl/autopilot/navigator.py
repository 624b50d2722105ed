"""From flight mode to what the flight controller shall follow: what PX4 calls its navigator and flight tasks."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.commander import Commander
from sitl.autopilot.flavour import Mode
from sitl.autopilot.flight_controller import Demand, EstimatedState
from sitl.autopilot.local_frame import LocalFrame
from sitl.autopilot.plan import Plan
from sitl.autopilot.rotation import Vec, wrap
from sitl.autopilot.trajectory import Trajectory

UNLIMITED_N = math.inf
_STOP: Vec = (0.0, 0.0, 0.0)
_LEAVE: Vec = (0.0, 0.0, 0.6)
"""Velocity at which the ground is left."""
_ARRIVED_M = 0.6
_YAW_RATE_RAD_S = math.radians(45.0)
_RTL_LAND_M = 1.0
_NOT_LEVEL_M_S2 = 0.9
"""How far from level an attitude is that is flown for level: a real one drifted at 1.5 m/s within two seconds."""
_MOVING_M_S = 0.05


class Navigator:
    """Holds the reference trajectory of the mode that is flown; `step` is called once a tick."""

    def __init__(self, commander: Commander, plan: Plan, place: LocalFrame, state: EstimatedState) -> None:
        self._commander, self._plan, self._place = commander, plan, place
        self._trajectory = Trajectory(commander.flavour.limits, state.position, state.velocity)
        self._seen_change = -1
        self._seen_setpoint = -1.0
        self._yaw: float = state.heading
        self._yaw_goal: float | None = None
        self._goal: Vec | None = None
        self._drift: Vec | None = None
        """Acceleration of a descent without horizontal control."""
        self._phase = 0
        self._item_since: float | None = None
        self._ramp_s = 0.0
        self.reposition: tuple[Vec | None, float | None] | None = None
        """An operator's "fly here" (ENU, heading): taken up at the next step."""
        self.condition_yaw: float | None = None

    @property
    def target(self) -> tuple[Vec, Vec, float]:
        """Position, velocity and heading that are followed now, for POSITION_TARGET_*."""
        t = self._trajectory
        return (t.position[0], t.position[1], t.position[2]), (t.velocity[0], t.velocity[1], t.velocity[2]), self._yaw

    @property
    def destination(self) -> Vec | None:
        """Where it goes to by itself (a "fly here", a waypoint); None while it follows setpoints or just stays."""
        following = self._commander.mode is Mode.OFFBOARD and self._commander.setpoint is not None
        return None if following else self._goal

    def step(
        self, now: float, dt: float, state: EstimatedState, grounded: bool, hover_n: float
    ) -> tuple[Demand | None, float]:
        """The demand now (None: motors idle) and the most thrust allowed (N)."""
        c = self._commander
        if not c.armed:
            self._rest(state)
            return None, 0.0
        if c.mode_changes != self._seen_change:
            self._seen_change = c.mode_changes
            self._begin(state)
        if c.landed and not self._wants_to_fly(state):
            self._rest(state)
            return None, UNLIMITED_N
        limit = self._spool_up(now, dt, state, grounded, hover_n)
        return self._demand(now, dt, state), limit

    def _rest(self, state: EstimatedState) -> None:
        self._ramp_s = 0.0
        self._begin(state)

    def _begin(self, state: EstimatedState) -> None:
        """Start the mode's trajectory where the aircraft is."""
        c = self._commander
        self._trajectory = Trajectory(c.flavour.limits, state.position, state.velocity)
        self._goal, self._phase, self._item_since, self._drift = None, 0, None, None
        self._yaw, self._yaw_goal = state.heading, None
        if c.takeoff_height is not None and c.mode in (Mode.TAKEOFF, Mode.OFFBOARD, Mode.HOLD) and not c.failsafe:
            if c.taking_off or c.mode is Mode.HOLD:
                self._goal = (state.position[0], state.position[1], c.takeoff_height)
            if c.mode is Mode.HOLD:
                c.takeoff_height = None

    def _wants_to_fly(self, state: EstimatedState) -> bool:
        c = self._commander
        if c.taking_off or (c.mode is Mode.MISSION and c.has_mission):
            return True
        if c.mode is Mode.OFFBOARD and c.flavour.name == "px4" and c.setpoint is not None:
            height, climb = c.setpoint.demand.position[2], c.setpoint.demand.velocity[2]
            return (height is not None and height > state.position[2] + 0.2) or (climb or 0.0) > 0.1
        return False

    def _spool_up(self, now: float, dt: float, state: EstimatedState, grounded: bool, hover_n: float) -> float:
        """The motors come up slowly; until the aircraft leaves the ground the thrust is limited."""
        c = self._commander
        if not c.landed and not (grounded and self._ramp_s > 0.0):
            self._ramp_s = 0.0
            return UNLIMITED_N
        self._ramp_s += dt
        share = (self._ramp_s - c.flavour.takeoff_delay_s) / c.flavour.takeoff_ramp_s
        self._trajectory = Trajectory(c.flavour.limits, state.position, _LEAVE)
        early = c.flavour.name == "px4" and share > 0.35  # PX4's land detector goes by the thrust
        if not grounded or early:
            c.lift_off(now)
        return max(0.0, 1.1 * share * hover_n)

    def _demand(self, now: float, dt: float, state: EstimatedState) -> Demand:
        c = self._commander
        if self.reposition is not None:
            self._goal, yaw = self.reposition
            self._yaw_goal = self._yaw_goal if yaw is None else yaw
            self.reposition = None
        if c.mode is Mode.OFFBOARD and not c.taking_off and c.setpoint is not None:
            fresh = c.setpoint.t_s != self._seen_setpoint
            self._seen_setpoint = c.setpoint.t_s
            if c.flavour.name == "px4":
                self._yaw = state.heading if c.setpoint.demand.yaw is None else c.setpoint.demand.yaw
                self._follow_raw(c.setpoint.demand, state)
                return c.setpoint.demand
            return self._guided(c.setpoint.demand, now - c.setpoint.t_s, fresh, dt, state)
        if c.mode is Mode.MISSION:
            self._fly_plan(now, state)
        elif c.mode is Mode.RTL:
            self._return(state)
        if c.without_sticks:
            return self._come_down_level(state)
        if c.mode is Mode.LAND or (c.mode is Mode.RTL and self._phase == 2):
            self._trajectory.step(None, (0.0, 0.0, -c.flavour.limits.descent_m_s), dt)
        else:
            self._trajectory.step(self._goal, _STOP, dt, self._climb_limit())
        return self._trajectory.demand(self._slewed_yaw(dt, state), None)

    def _come_down_level(self, state: EstimatedState) -> Demand:
        """No horizontal control: an attitude that is taken for level, and so a drift the way that it went."""
        c = self._commander
        self._trajectory = Trajectory(c.flavour.limits, state.position, state.velocity)
        if self._drift is None:  # which way is decided once
            east, north, _ = state.velocity
            size = math.hypot(east, north)
            way = (east / size, north / size) if size > _MOVING_M_S else (1.0, 0.0)
            self._drift = (_NOT_LEVEL_M_S2 * way[0], _NOT_LEVEL_M_S2 * way[1], 0.0)
        return Demand(velocity=(None, None, -c.flavour.limits.descent_m_s), acceleration=self._drift, yaw=self._yaw)

    def _climb_limit(self) -> float | None:
        return 1.5 if self._commander.taking_off else None

    def _follow_raw(self, demand: Demand, state: EstimatedState) -> None:
        """Keep the reported target and the next mode's start in step with setpoints that are flown as they are."""
        for i in range(3):
            place, speed = demand.position[i], demand.velocity[i]
            self._trajectory.position[i] = state.position[i] if place is None else place
            self._trajectory.velocity[i] = speed or 0.0

    def _guided(self, wanted: Demand, age_s: float, fresh: bool, dt: float, state: EstimatedState) -> Demand:
        """ArduPilot GUIDED: positions have no timeout, velocities stop after GUID_TIMEOUT."""
        c = self._commander
        east, north, up = wanted.position
        ve, vn, vu = (v or 0.0 for v in wanted.velocity)
        timed_out = age_s > c.parameters.number("GUID_TIMEOUT")
        moving = any(v is not None for v in wanted.velocity)
        if timed_out and moving:
            ve = vn = vu = 0.0
        yaw, yaw_rate = wanted.yaw, wanted.yaw_rate
        if yaw is not None:
            self._yaw_goal = yaw
        elif yaw_rate is None and not timed_out and math.hypot(ve, vn) > 0.5:
            self._yaw_goal = math.atan2(ve, vn)  # neither given: the nose turns into the track
        elif yaw_rate is not None and not timed_out:
            self._yaw, self._yaw_goal = state.heading, None
        if east is None or north is None or up is None or (timed_out and moving):
            self._trajectory.step(None, (ve, vn, vu), dt)
            self._goal = None
        else:
            held = self._goal
            if fresh or held is None:
                held = (east, north, up)
            else:  # between messages the target runs on with its velocity
                held = (held[0] + ve * dt, held[1] + vn * dt, held[2] + vu * dt)
            self._goal = held
            self._trajectory.step(held, (ve, vn, vu), dt)
        turning = yaw is None and yaw_rate is not None and not timed_out
        if turning:
            return self._trajectory.demand(None, yaw_rate)
        return self._trajectory.demand(self._slewed_yaw(dt, state, streaming=not timed_out), None)

    def _slewed_yaw(self, dt: float, state: EstimatedState, streaming: bool = False) -> float:
        """Heading demand, turned no faster than the autonomous modes turn; a region of interest goes first."""
        c = self._commander
        guided = c.flavour.name == "ardupilot" and c.mode is Mode.OFFBOARD
        if guided and self.condition_yaw is not None:
            self._yaw_goal, self.condition_yaw = self.condition_yaw, None
        goal = self._yaw_goal
        if c.roi is not None and not streaming and not c.taking_off and (guided or c.mode is Mode.MISSION):
            goal = math.atan2(c.roi[0] - state.position[0], c.roi[1] - state.position[1])
        if goal is not None:
            most = _YAW_RATE_RAD_S * dt
            self._yaw = wrap(self._yaw + max(-most, min(most, wrap(goal - self._yaw))))
        return self._yaw

    def _return(self, state: EstimatedState) -> None:
        c = self._commander
        px4 = c.flavour.name == "px4"
        height = c.parameters.number("RTL_RETURN_ALT") if px4 else c.parameters.number("RTL_ALT") / 100
        if self._phase == 0:
            e, n, u = state.position
            near = math.dist((e, n), c.home[:2]) < 5.0
            self._goal = (e, n, u if near else max(u, c.home[2] + height)) if self._goal is None else self._goal
            self._phase = int(self._goal[2] - u < _RTL_LAND_M)
        elif self._phase == 1:
            top = self._goal[2] if self._goal is not None else state.position[2]
            self._goal = (c.home[0], c.home[1], top)
            if math.dist(state.position[:2], c.home[:2]) < _RTL_LAND_M:
                self._phase = 2

    def _fly_plan(self, now: float, state: EstimatedState) -> None:
        """Waypoints, take-off, landing, return and regions of interest, one item after the other."""
        c, plan = self._commander, self._plan
        item = plan.current_item()
        if item is None:
            return
        self._goal = self._goal or state.position
        command = item.command
        if command == mavlink.MAV_CMD_NAV_LAND:
            c.request_mode(Mode.LAND, now)
        elif command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            c.request_mode(Mode.RTL, now)
        elif command in (mavlink.MAV_CMD_DO_SET_ROI_LOCATION, mavlink.MAV_CMD_DO_SET_ROI):
            c.roi = plan.position(item, self._place, c.home[2])
            self._next(now)
        elif command == mavlink.MAV_CMD_DO_SET_ROI_NONE:
            c.roi = None
            self._next(now)
        elif command in plan.PLACES:
            e, n, u = plan.position(item, self._place, c.home[2])
            if command == mavlink.MAV_CMD_NAV_TAKEOFF:
                e, n = self._goal[0], self._goal[1]
            if self._goal != (e, n, u):
                self._goal = (e, n, u)
                self._yaw_goal = math.atan2(e - state.position[0], n - state.position[1])
            if math.dist(self._goal, state.position) < _ARRIVED_M:
                self._item_since = now if self._item_since is None else self._item_since
                wait = item.params[0] if command == mavlink.MAV_CMD_NAV_WAYPOINT else 0.0
                if command != mavlink.MAV_CMD_NAV_LOITER_UNLIM and now - self._item_since >= wait:
                    self._next(now)
        else:
            self._next(now)

    def _next(self, now: float) -> None:
        self._item_since = None
        if not self._plan.advance() and self._commander.flavour.name == "px4":
            self._commander.request_mode(Mode.HOLD, now)  # ArduPilot stays in AUTO at the last item
