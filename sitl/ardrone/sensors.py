"""What the aircraft believes about its motion: how far its sensors stray from the truth.

Velocity comes from the optical flow of the downward camera scaled by the sonar's height: its error has a part that
grows with the speed (texture, height, lens), a slow wander and a small constant. Attitude comes from gyros and
accelerometers, heading from gyros and compass. Without GPS nothing bounds the position. No recording of this aircraft
with its truth was at hand: the sizes are judgements (docs/ardrone.md), not measurements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sitl.autopilot.rotation import Vec
from sitl.gauss_markov import STILL, GaussMarkov, Wander

SensorNoiseName = Literal["good", "rough", "none"]
_DEG = math.radians(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorNoise:
    """Sizes of the errors (1 sigma), none by default: SI units and radians; offsets are drawn once a flight."""

    flow_scale: float = 0.0
    flow_offset_m_s: float = 0.0
    flow: Wander = STILL
    height_offset_m: float = 0.0
    height: Wander = STILL
    climb: Wander = STILL
    tilt_offset_rad: float = 0.0
    """After a flat trim; before it, the aircraft does not know level to better than `untrimmed_rad`."""
    untrimmed_rad: float = 0.0
    tilt: Wander = STILL
    compass_offset_rad: float = 0.0
    heading: Wander = STILL
    gps: Wander = STILL


PRESETS: dict[SensorNoiseName, SensorNoise] = {
    "good": SensorNoise(
        flow_scale=0.03,
        flow_offset_m_s=0.02,
        flow=Wander(0.04, 1.0),
        height_offset_m=0.02,
        height=Wander(0.015, 0.8),
        climb=Wander(0.03, 0.5),
        tilt_offset_rad=0.3 * _DEG,
        untrimmed_rad=1.0 * _DEG,
        tilt=Wander(0.15 * _DEG, 3.0),
        compass_offset_rad=3.0 * _DEG,
        heading=Wander(0.3 * _DEG, 2.0),
        gps=Wander(0.8, 25.0, 1),
    ),
    "rough": SensorNoise(
        flow_scale=0.08,
        flow_offset_m_s=0.05,
        flow=Wander(0.12, 1.5),
        height_offset_m=0.05,
        height=Wander(0.04, 0.8),
        climb=Wander(0.08, 0.5),
        tilt_offset_rad=0.8 * _DEG,
        untrimmed_rad=2.0 * _DEG,
        tilt=Wander(0.6 * _DEG, 4.0),
        compass_offset_rad=8.0 * _DEG,
        heading=Wander(1.0 * _DEG, 2.0),
        gps=Wander(2.0, 25.0, 1),
    ),
    "none": SensorNoise(),
}


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Estimate minus truth at an instant, except for the flow's scale."""

    flow_scale: float
    """Measured over true velocity, minus 1."""
    flow_m_s: tuple[float, float]
    """Forward and right, on top of the scale."""
    height_m: float
    climb_m_s: float
    roll_rad: float
    pitch_rad: float
    heading_rad: float
    """Of the fused heading: the compass's offset and the slow wander."""
    gps_enu_m: Vec


class Sensors:
    """The errors of one flight, advanced in fixed steps."""

    def __init__(self, noise: SensorNoise, dt: float, rng: np.random.Generator) -> None:
        self._noise = noise
        self._scale = noise.flow_scale * float(rng.standard_normal())
        self._flow = noise.flow_offset_m_s * rng.standard_normal(2)
        self._height = noise.height_offset_m * float(rng.standard_normal())
        self._tilt = noise.untrimmed_rad * rng.standard_normal(2)
        self._trimmed = noise.tilt_offset_rad * rng.standard_normal(2)
        self.compass_offset_rad = noise.compass_offset_rad * float(rng.standard_normal())
        """Error of the magnetic heading, the same for the whole flight."""
        n = noise
        wanders = (n.flow, n.flow, n.height, n.climb, n.tilt, n.tilt, n.heading, n.gps, n.gps, n.gps)
        self._processes = GaussMarkov(wanders, dt, rng)

    def flat_trim(self) -> None:
        """The aircraft stands level and takes this as horizontal."""
        self._tilt = self._trimmed

    def step(self) -> SensorErrors:
        """Advance by one step and return the errors."""
        self._processes.step()
        forward, right, height, climb, roll, pitch, heading, *gps = self._processes.values.tolist()
        return SensorErrors(
            flow_scale=self._scale,
            flow_m_s=(forward + float(self._flow[0]), right + float(self._flow[1])),
            height_m=height + self._height,
            climb_m_s=climb,
            roll_rad=roll + float(self._tilt[0]),
            pitch_rad=pitch + float(self._tilt[1]),
            heading_rad=heading + self.compass_offset_rad,
            gps_enu_m=(gps[0], gps[1], 1.5 * gps[2]),
        )
