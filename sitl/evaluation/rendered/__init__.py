"""Whole flights past a person without real time: motion, telemetry, camera and video codec in lockstep."""

from sitl.evaluation.rendered.case import Case, SceneName, drawn_cases
from sitl.evaluation.rendered.flight import Moment, RenderedFlight, flights

__all__ = ["Case", "Moment", "RenderedFlight", "SceneName", "drawn_cases", "flights"]
