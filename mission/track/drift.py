"""A number that drifts: Kalman filter for a value whose rate of change wanders but does not run away."""

from __future__ import annotations

import numpy as np

_TRUSTED = 2.0
"""Innovations beyond this many standard deviations count only as much as one of that size (Huber's rule)."""


class DriftFilter:
    """State (value, rate); the rate is a first-order Gauss-Markov process (Singer's model, one derivative lower).

    A measurement far from what is expected has a bounded influence but is never refused: refusing would leave the
    filter alone with its own rate once that is wrong.

    Args:
        value: the first value.
        sigma: its standard deviation.
        rate_sigma: standard deviation of the rate, in values per second.
        rate_s: correlation time of the rate.
    """

    def __init__(self, value: float, sigma: float, rate_sigma: float, rate_s: float) -> None:
        self._state = np.array([value, 0.0])
        self._covariance = np.diag([sigma**2, rate_sigma**2])
        self._rate_s = rate_s

    @property
    def value(self) -> float:
        """Filtered value."""
        return float(self._state[0])

    @property
    def rate(self) -> float:
        """Filtered rate of change, per second."""
        return float(self._state[1])

    @property
    def sigma(self) -> float:
        """Of the value, if the measurements' errors were white."""
        return float(np.sqrt(self._covariance[0, 0]))

    def predict(self, dt_s: float, rate_sigma: float, shift: float = 0.0) -> None:
        """To a later time.

        Args:
            dt_s: how much later.
            rate_sigma: standard deviation of the rate by now.
            shift: a known change of the value.
        """
        kept = float(np.exp(-dt_s / self._rate_s))
        step = np.array([[1.0, self._rate_s * (1.0 - kept)], [0.0, kept]])
        psd = 2.0 * rate_sigma**2 / self._rate_s
        noise = psd * np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]])
        self._state = step @ self._state + [shift, 0.0]
        self._covariance = step @ self._covariance @ step.T + noise

    def settle(self) -> None:
        """Forget the rate."""
        self._state[1] = 0.0

    def update(self, measured: float, sigma: float) -> None:
        """Use a measurement with its standard deviation."""
        innovation = measured - self.value
        variance = float(self._covariance[0, 0]) + sigma**2
        excess = abs(innovation) / (_TRUSTED * np.sqrt(variance))
        gain = self._covariance[:, 0] / (variance * max(1.0, excess))
        self._state = self._state + gain * innovation
        self._covariance = self._covariance - np.outer(gain, self._covariance[0])
