"""Points seen again: on the way back the camera comes past where it was, and old points are found once more there.

A point that leaves the picture on the way out is a new one when it comes back, and then the end of the path hangs on
its beginning by a chain of short tracks whose drift adds up. But out and back means that each picture of the way back
has a twin on the way out, taken from nearly the same place: there every window looks as it did, and Lucas-Kanade from
the twin's points finds them directly (loop closure). The twin and the shift between both are found by phase
correlation of thumbnails (Kuglin & Hines 1975): what has moved all together gives one sharp peak, and parallax, which
there is between other places, blurs it. So no pose is asked for, and a wandering compass does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.records import Image

_SHRUNK = 4
"""Work pixels per pixel of a thumbnail."""
_LEAST_APART_S = 1.0
"""Between a picture and its twin: before that most points are still followed."""
_LEAST_PEAK = 0.3
"""Of the correlation of two thumbnails, 1 when they are shifted copies. On rendered flights the best of pictures that
share only the walker in the middle reached 0.29, the same place seen again 0.3 to 0.7."""
_SMOOTHED = 0.15
"""Cycles per thumbnail pixel at which the Gaussian low pass has fallen to exp(-1/2): beyond it there is video noise."""
MOST_PICTURES = 64


@dataclass(frozen=True, slots=True)
class Twin:
    """An earlier picture from about the same place."""

    number: int
    """Of the earlier picture."""
    shift: tuple[float, float]
    """Where its middle is in the present one: to the right and down, work pixels."""
    peak: float
    """Of the correlation."""


class SeenPatches:
    """Spectra of earlier pictures.

    Args:
        size: width and height of the pictures.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._small = max(8, size[0] // _SHRUNK), max(8, size[1] // _SHRUNK)
        width, height = self._small
        self._window = np.outer(np.hanning(height), np.hanning(width)).astype(np.float32)
        down, across = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None, :]
        low = np.exp(-0.5 * (np.square(down) + np.square(across)) / _SMOOTHED**2)
        low[0, 0] = 0.0
        # So that the peak of a picture with itself is 1.
        self._low = (low / np.fft.irfft2(low, s=(height, width)).max()).astype(np.float32)
        self._times: list[float] = []
        self._numbers: list[int] = []
        self._spectra = np.zeros((MOST_PICTURES, height, width // 2 + 1), dtype=np.complex64)

    def look(self, grey: Image, t_s: float, number: int) -> Twin | None:
        """Which earlier picture was taken from about the same place; the present one is kept for later ones.

        Args:
            grey: (h, w).
            t_s: when it was taken; later than those before.
            number: what to call it.
        """
        spectrum = self._spectrum(grey)
        old = int(np.searchsorted(self._times, t_s - _LEAST_APART_S, side="right"))
        twin = self._best(spectrum, old) if old > 0 else None
        if len(self._times) < MOST_PICTURES:
            self._spectra[len(self._times)] = spectrum
            self._times.append(t_s)
            self._numbers.append(number)
        return twin

    def _best(self, spectrum: NDArray[np.complex64], old: int) -> Twin | None:
        width, height = self._small
        peaks = np.fft.irfft2(self._low * spectrum * np.conj(self._spectra[:old]), s=(height, width), axes=(1, 2))
        best, place = divmod(int(peaks.argmax()), width * height)
        peak = float(peaks[best].flat[place])
        if peak < _LEAST_PEAK:
            return None
        down, across = divmod(place, width)
        right = across - width if across > width // 2 else across
        below = down - height if down > height // 2 else down
        return Twin(self._numbers[best], (float(right * _SHRUNK), float(below * _SHRUNK)), peak)

    def _spectrum(self, grey: Image) -> NDArray[np.complex64]:
        small = cv2.resize(grey, self._small, interpolation=cv2.INTER_AREA).astype(np.float32)
        spectrum = np.fft.rfft2((small - small.mean()) * self._window)
        return np.asarray(spectrum / np.maximum(np.abs(spectrum), 1e-6), dtype=np.complex64)
