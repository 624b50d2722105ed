"""The aircraft's body: RotorPy's multirotor model in a gusty wind, on a flat ground at height 0."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray
from rotorpy.vehicles.multirotor import Multirotor
from rotorpy.vehicles.px4_sihsim_quadx_params import quad_params

from mission.records import Vector
from sitl.autopilot.rotation import Quat, Vec, from_euler

GRAVITY_M_S2 = 9.81
_REST_HEIGHT_M = 0.001


class RotorState(TypedDict):
    """RotorPy's state: world z up, body forward-left-up, quaternion (x, y, z, w)."""

    x: NDArray[np.float64]
    v: NDArray[np.float64]
    q: NDArray[np.float64]
    w: NDArray[np.float64]
    wind: NDArray[np.float64]
    rotor_speeds: NDArray[np.float64]


class _HeunMultirotor(Multirotor):  # type: ignore[misc]  # RotorPy has no types
    """RotorPy's dynamics with one Heun step instead of an adaptive solver: a fifth of the time, 5 ms is short enough.

    The fastest time constant (the motors', 50 ms) is ten steps long.
    """

    def step(self, state: RotorState, control: dict[str, object], t_step: float) -> RotorState:
        speeds = np.clip(self.get_cmd_motor_speeds(state, control), self.rotor_speed_min, self.rotor_speed_max)
        s = Multirotor._pack_state(state)
        k1 = self._s_dot_fn(0.0, s, speeds)
        k2 = self._s_dot_fn(t_step, s + t_step * k1, speeds)
        after: RotorState = Multirotor._unpack_state(s + (0.5 * t_step) * (k1 + k2))
        after["q"] /= math.sqrt(float(after["q"] @ after["q"]))
        if self._enable_ground and self._on_ground(after):
            after = self._handle_vehicle_on_ground(after)
        return after


@dataclass(frozen=True, slots=True)
class Wind:
    """Mean wind (where it blows to, ENU) and the standard deviation of its gusts on each horizontal axis."""

    mean_enu_m_s: Vec = (0.0, 0.0, 0.0)
    gust_m_s: float = 0.0
    gust_length_s: float = 3.0
    """Correlation time of the gusts, in the order of the Dryden model's length over speed near the ground."""


class Airframe:
    """A 1 kg quadrotor, PX4's SIH quad X as RotorPy gives it, with linear drag added.

    Args:
        drag_n_s_m: force per speed through the air at hover thrust; SIH's is 1 N s/m.
        wind: the air's motion.
        heading_rad: where the nose points at the start, clockwise from north.
        rng: for the gusts.
    """

    def __init__(self, drag_n_s_m: float, wind: Wind, heading_rad: float, rng: np.random.Generator) -> None:
        params = dict(quad_params)
        self.mass_kg = float(params["mass"])
        hover_speed = math.sqrt(self.mass_kg * GRAVITY_M_S2 / (4 * float(params["k_eta"])))
        params["k_d"] = drag_n_s_m / (4 * hover_speed)
        self._body = _HeunMultirotor(params, control_abstraction="cmd_ctbm", enable_ground=True)
        self.inertia: Vec = (float(params["Ixx"]), float(params["Iyy"]), float(params["Izz"]))
        self.thrust_max_n = 4 * float(params["k_eta"]) * float(params["rotor_speed_max"]) ** 2
        self._wind = wind
        self._gust = np.zeros(2)
        self._rng = rng
        w, x, y, z = from_euler(0.0, 0.0, math.pi / 2 - heading_rad)
        self._state: RotorState = {
            "x": np.zeros(3),
            "v": np.zeros(3),
            "q": np.array([x, y, z, w]),
            "w": np.zeros(3),
            "wind": np.zeros(3),
            "rotor_speeds": np.zeros(4),
        }

    @property
    def position(self) -> Vec:
        """ENU, metres."""
        x = self._state["x"]
        return float(x[0]), float(x[1]), float(x[2])

    @property
    def velocity(self) -> Vec:
        """ENU, m/s."""
        v = self._state["v"]
        return float(v[0]), float(v[1]), float(v[2])

    @property
    def world_from_flu(self) -> Quat:
        """Attitude, ENU from forward-left-up."""
        x, y, z, w = self._state["q"]
        return float(w), float(x), float(y), float(z)

    @property
    def rates_flu(self) -> Vec:
        """Angular velocity about the body's forward, left and up axes, rad/s."""
        w = self._state["w"]
        return float(w[0]), float(w[1]), float(w[2])

    @property
    def grounded(self) -> bool:
        """Whether it stands on the ground."""
        return float(self._state["x"][2]) <= _REST_HEIGHT_M

    @property
    def wind(self) -> Vector:
        """The air's velocity now, (3,), ENU, m/s."""
        return self._state["wind"]

    def place(self, position: Vec) -> None:
        """Put it somewhere, at rest and at hover thrust."""
        hover = math.sqrt(self.mass_kg * GRAVITY_M_S2 / (4 * float(self._body.k_eta)))
        self._state["x"], self._state["v"] = np.array(position), np.zeros(3)
        self._state["rotor_speeds"] = np.full(4, hover)

    def step(self, dt: float, thrust_n: float, moment_flu_nm: Vec) -> None:
        """Advance by dt seconds with a collective thrust and moments about the body's axes."""
        self._state["wind"] = self._blow(dt)
        if thrust_n <= 0.0 and self.grounded:
            self._state["rotor_speeds"] *= math.exp(-dt / 0.2)
            self._state["v"][:] = 0.0
            return
        control = {"cmd_thrust": thrust_n, "cmd_moment": np.array(moment_flu_nm)}
        self._state = self._body.step(self._state, control, dt)

    def _blow(self, dt: float) -> NDArray[np.float64]:
        if self._wind.gust_m_s > 0.0:
            keep = math.exp(-dt / self._wind.gust_length_s)
            drive = self._wind.gust_m_s * math.sqrt(1.0 - keep * keep)
            self._gust = keep * self._gust + drive * self._rng.standard_normal(2)
        east, north, up = self._wind.mean_enu_m_s
        return np.array([east + self._gust[0], north + self._gust[1], up])
