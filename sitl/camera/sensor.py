"""The sensor: brightness, an automatic exposure that wanders, and noise."""

from __future__ import annotations

import math

import cv2
import numpy as np

from mission.records import Image
from sitl.scenario.schema import Scenario

_BANK_MARGIN_PX = 64
_BANK_ZERO = 128
"""What stands for no noise in the bank, whose bytes cannot be negative."""


class Sensor:
    """Turns light into numbers.

    The noise has the same standard deviation at all grey levels: gamma encoding evens out the shot noise of real
    sensors.
    """

    def __init__(self, scenario: Scenario) -> None:
        camera = scenario.camera
        rng = np.random.default_rng([scenario.seed, 3])
        self._brightness = scenario.light.brightness
        self._wander = camera.exposure_wander
        self._phases = rng.uniform(0.0, 2.0 * math.pi, 3)
        self._size = (camera.height_px, camera.width_px)
        self._bank = None
        if camera.noise_grey > 0.0:
            shape = (camera.height_px + _BANK_MARGIN_PX, camera.width_px + _BANK_MARGIN_PX)
            grey = rng.normal(0.0, 0.9 * camera.noise_grey, shape)[:, :, None]
            colour = rng.normal(0.0, 0.44 * camera.noise_grey, (*shape, 3))
            self._bank = np.clip(np.rint(grey + colour) + _BANK_ZERO, 1, 255).astype(np.uint8)

    def gain(self, t_s: float) -> float:
        """How bright the automatic exposure makes the picture at a time, 1 on average: it wanders within seconds."""
        a, b, c = self._phases
        slow = math.sin(2.0 * math.pi * 0.071 * t_s + a) + 0.6 * math.sin(2.0 * math.pi * 0.19 * t_s + b)
        return self._brightness * (1.0 + self._wander * 0.6 * (slow + 0.3 * math.sin(2.0 * math.pi * 0.43 * t_s + c)))

    def expose(self, picture: Image, t_s: float) -> Image:
        """The picture as the sensor gives it at a time (the same time gives the same noise)."""
        gain = self.gain(t_s)
        if self._bank is None:
            return np.asarray(cv2.convertScaleAbs(picture, alpha=gain), np.uint8)
        top, left = np.random.default_rng(abs(int(t_s * 1e6))).integers(0, _BANK_MARGIN_PX, 2)
        noise = self._bank[top : top + self._size[0], left : left + self._size[1]]
        # One pass for both, a third of the time of two; what is over-exposed stays white.
        return np.asarray(cv2.addWeighted(picture, gain, noise, 1.0, -_BANK_ZERO), np.uint8)
