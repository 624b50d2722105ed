"""How good the attitude is that a gimbal reports, as a noise model of the lens's pose.

Users' reports and makers' data: a stabilised lens is steady to 0.02 to 0.1 degrees and level to some tenths, better
than the airframe that carries it; but its yaw is 0 to 5 degrees off nearly always, and 20 where it was switched on near
iron.
Servos report what they are told to do, and sag.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from mission.gimbal.reading import Reference
from mission.records import NoiseModel

YAW_BIAS_SIGMA_RAD: Final = math.radians(5.0)
_WANDER_RAD: Final = math.radians(0.1)
_LEVEL_BIAS_RAD: Final = math.radians(0.5)
_COMMANDED_RAD: Final = math.radians(2.0)
_COMMANDED_BIAS_RAD: Final = math.radians(3.0)


def gimbal_noise(aircraft: NoiseModel, reference: Reference, *, measured: bool) -> NoiseModel:
    """The noise of the lens's pose.

    Args:
        aircraft: of the aircraft's own pose, whose place is also the lens's.
        reference: what the gimbal's angles are measured from.
        measured: whether they are measured; else they are what the gimbal was told to do.
    """
    wander, bias = (_WANDER_RAD, _LEVEL_BIAS_RAD) if measured else (_COMMANDED_RAD, _COMMANDED_BIAS_RAD)
    nose = reference != "north"
    body = reference == "airframe"
    return replace(
        aircraft,
        heading_bias_sigma_rad=math.hypot(YAW_BIAS_SIGMA_RAD, aircraft.heading_bias_sigma_rad if nose else 0.0),
        heading_sigma_rad=math.hypot(wander, aircraft.heading_sigma_rad if nose else 0.0),
        tilt_bias_sigma_rad=math.hypot(bias, aircraft.tilt_bias_sigma_rad if body else 0.0),
        tilt_sigma_rad=math.hypot(wander, aircraft.tilt_sigma_rad if body else 0.0),
    )
