"""The interface that all methods share."""

from __future__ import annotations

from typing import Protocol

from mission.records import Estimate, FlightSightings


class Estimator(Protocol):
    """A method that turns one flight's sightings into an estimate."""

    @property
    def name(self) -> str:
        """What `--method` and the estimate call it."""
        ...

    def estimate(self, flight: FlightSightings) -> Estimate:
        """Where the target is.

        Args:
            flight: the sightings with their noise model and prior.

        Returns:
            The estimate, in the flight's local ENU frame.

        Raises:
            EstimateRefused: the sightings cannot support a position; it says why and what would help.
        """
        ...
