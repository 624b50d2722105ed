"""Sightings to estimate: one interface, the field's methods beside each other."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mission.estimate.batch import Batch
from mission.estimate.classical import Classical
from mission.estimate.constant_velocity import ConstantVelocity
from mission.estimate.estimator import Estimator
from mission.estimate.four_image import FourImage
from mission.estimate.stereo import Stereo
from mission.estimate.three_image import ThreeImage

_METHODS: tuple[Estimator, ...] = (Batch(), ConstantVelocity(), ThreeImage(), FourImage(), Stereo(), Classical())

ESTIMATORS: Mapping[str, Estimator] = MappingProxyType({method.name: method for method in _METHODS})
"""The methods by the name that `--method` gives them."""

__all__ = ["ESTIMATORS", "Batch", "Classical", "ConstantVelocity", "Estimator", "FourImage", "Stereo", "ThreeImage"]
