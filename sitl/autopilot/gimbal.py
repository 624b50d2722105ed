"""A gimbal's motors and sensors: where the lens really looks, and what it says about that.

It is stepped with the aircraft's true attitude and with the heading that the autopilot takes itself to have. Its sensor
has a zero error in yaw (`bias`), which its control loop follows: told to look north it looks beside it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from sitl.autopilot.gimbal_settings import GimbalSettings
from sitl.autopilot.rotation import FLU_FROM_FRD, NED_FROM_ENU, Quat, Vec, from_euler, multiply, to_euler, wrap
from sitl.gauss_markov import GaussMarkov, Wander

_BIAS_SIGMA_RAD = math.radians(5.0)
_WANDER_TAU_S = 0.7
_SERVO_SAG_RAD = math.radians(1.0)


@dataclass(frozen=True, slots=True)
class Report:
    """What the gimbal measured at one time."""

    t_s: float
    reference_from_gimbal: Quat
    """By its convention: from north-east-down, from the level nose, or from the airframe."""
    rates: Vec
    """About the gimbal's own axes, rad/s."""
    delta_yaw: float
    """The vehicle's heading as the gimbal has it; NaN where it does not tell."""
    stops: tuple[bool, bool, bool]
    """Roll, pitch, yaw at a limit."""


@dataclass(slots=True)
class Target:
    """Where it is told to look; radians."""

    pitch: float
    yaw: float = 0.0
    lock: bool = False
    """Yaw from north, and not from the nose."""
    pitch_rate: float = 0.0
    yaw_rate: float = 0.0


class Gimbal:
    """Advanced in steps of `dt` seconds.

    Args:
        settings: of its kind.
        dt: of a step.
        seed: of its zero error and its noise.
        heading: of the nose at the start, true.
    """

    def __init__(self, settings: GimbalSettings, dt: float, seed: int, heading: float) -> None:
        self.settings = settings
        self._rng = np.random.default_rng((seed, 71))
        drawn = _BIAS_SIGMA_RAD * float(self._rng.standard_normal())
        self.bias = drawn if settings.yaw_bias_deg is None else math.radians(settings.yaw_bias_deg)
        """Of the yaw that it reports, over the true one."""
        sag = _SERVO_SAG_RAD * self._rng.standard_normal(2)
        self._sag = (float(sag[0]), float(sag[1]))
        self.target = Target(math.radians(settings.start_pitch_deg))
        self._dt = dt
        self._pitch = self.target.pitch
        self._yaw = heading
        """True, from north."""
        self._followed = heading
        self._servo: list[float] = [0.0, self._pitch, 0.0]
        self._commanded: Vec = (0.0, self._pitch, 0.0)
        self._wander = GaussMarkov((Wander(math.radians(settings.wander_deg), _WANDER_TAU_S),) * 3, dt, self._rng)
        self._stops = (False, False, False)
        self._rates: Vec = (0.0, 0.0, 0.0)
        self.ned_from_gimbal: Quat = from_euler(0.0, self._pitch, heading)
        """True."""
        self._reports: deque[Report] = deque()
        self._due_s = -math.inf
        self.frozen = False
        """A fault: it goes on moving, and reports for ever what it reported last."""
        self.silent = False
        """A fault: it reports nothing."""

    def step(self, now: float, body: Quat, believed: Quat) -> None:
        """Move for one step.

        Args:
            now: time.
            body: true attitude, north-east-down from forward-right-down.
            believed: the same as the autopilot estimates it.
        """
        target, dt = self.target, self._dt
        target.pitch = self._within(target.pitch + target.pitch_rate * dt, self.settings.pitch_range_deg)
        target.yaw = wrap(target.yaw + target.yaw_rate * dt)
        self._wander.step()
        if self.settings.kind == "servo":
            self._step_servo(body, believed)
        else:
            self._step_stabilised(to_euler(body)[2], to_euler(believed)[2])
        if now >= self._due_s - 1e-6 and not self.frozen:
            self._due_s = max(self._due_s, now - dt) + 1.0 / self.settings.rate_hz
            self._reports.append(self._measured(now, to_euler(body)[2]))
        while len(self._reports) > 1 and self._reports[1].t_s <= now - 1e-3 * self.settings.age_ms:
            self._reports.popleft()

    def report(self, now: float) -> Report | None:
        """What it sends now: what it measured some time ago."""
        if self.silent or not self._reports or self._reports[0].t_s > now - 1e-3 * self.settings.age_ms:
            return None
        return self._reports[0]

    @property
    def world_from_gimbal(self) -> Quat:
        """True attitude, east-north-up from forward-right-down."""
        return multiply(NED_FROM_ENU, self.ned_from_gimbal)

    def _step_stabilised(self, heading: float, believed: float) -> None:
        target, settings, dt = self.target, self.settings, self._dt
        lag = max(settings.follow_lag_s, dt)
        self._followed = wrap(self._followed + wrap(believed - self._followed) * min(1.0, dt / lag))
        told = self._yaw + self.bias  # as its sensor has it, from north
        if settings.tells in ("nose", "older"):  # an encoder on the yoke: from the nose, and north is the autopilot's
            told = wrap(self._yaw - heading + self.bias) + believed
        wanted = target.yaw if target.lock else self._followed + target.yaw
        most = math.radians(settings.rate_limit_deg_s)
        yaw_rate = max(-most, min(most, wrap(wanted - told) / settings.lag_s))
        pitch_rate = max(-most, min(most, (target.pitch - self._pitch) / settings.lag_s))
        before = self._yaw, self._pitch
        self._pitch = self._within(self._pitch + pitch_rate * dt, settings.pitch_range_deg)
        from_nose = wrap(self._yaw + yaw_rate * dt - heading)
        held = self._within(from_nose, settings.yaw_range_deg)
        self._yaw = wrap(heading + held)
        low, high = settings.pitch_range_deg
        at_pitch = not math.radians(low) < target.pitch < math.radians(high)
        self._stops = (False, at_pitch, abs(held - from_nose) > 1e-9)
        turn = wrap(self._yaw - before[0]) / dt
        self._rates = (
            -turn * math.sin(self._pitch),
            (self._pitch - before[1]) / dt,
            turn * math.cos(self._pitch),
        )
        roll_off, pitch_off, yaw_off = self._wander.values
        self.ned_from_gimbal = from_euler(float(roll_off), self._pitch + float(pitch_off), self._yaw + float(yaw_off))

    def _step_servo(self, body: Quat, believed: Quat) -> None:
        """Roll and pitch are turned against what the autopilot takes for its own; yaw stays the nose's."""
        roll, pitch, _ = to_euler(believed)
        wanted = (-roll, self.target.pitch - pitch, 0.0)
        for axis, angle in enumerate(wanted):
            self._servo[axis] += (angle - self._servo[axis]) * min(1.0, self._dt / self.settings.lag_s)
        sagged = (self._servo[0] + self._sag[0], self._servo[1] + self._sag[1], self._servo[2])
        self.ned_from_gimbal = multiply(body, from_euler(*sagged))
        self._commanded = wanted

    def _measured(self, now: float, heading: float) -> Report:
        nothing: Vec = (math.nan, math.nan, math.nan)
        if self.settings.kind == "servo":
            return Report(now, from_euler(*self._commanded), nothing, math.nan, (False, False, False))
        noise = np.radians(self.settings.noise_deg) * self._rng.standard_normal(3)
        roll, pitch = float(noise[0]), self._pitch + float(noise[1])
        if self.settings.tells == "north":
            yaw, delta = self._yaw + self.bias, math.nan
        else:
            yaw, delta = self._yaw - heading + self.bias, math.nan
            if self.settings.tells == "nose-delta":
                # Its own compass has the whole bias; its encoder none.
                yaw, delta = self._yaw - heading, wrap(heading + self.bias)
        yaw = wrap(yaw + float(noise[2]))
        return Report(now, from_euler(roll, pitch, yaw), self._rates, delta, self._stops)

    @staticmethod
    def _within(angle: float, range_deg: tuple[float, float]) -> float:
        low, high = range_deg
        return max(math.radians(low), min(math.radians(high), angle))


def ned_from_frd(world_from_flu: Quat) -> Quat:
    """An airframe's true attitude as `Gimbal.step` wants it."""
    return multiply(NED_FROM_ENU, multiply(world_from_flu, FLU_FROM_FRD))
