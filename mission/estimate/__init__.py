"""Sightings to estimate: one interface, the field's methods beside each other."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mission.estimate.batch import Batch
from mission.estimate.estimator import Estimator

ESTIMATORS: Mapping[str, Estimator] = MappingProxyType({"batch": Batch()})
"""The methods by the name that `--method` gives them."""

__all__ = ["ESTIMATORS", "Batch", "Estimator"]
