"""Where the lens is, from where the aircraft is: the camera's mounting, and the aircraft's true pose at any time."""

from __future__ import annotations

import math

import numpy as np

from mission.records import Vector
from sitl.aircraft.truth import TruthRing, VehicleTruth
from sitl.camera.renderer import CameraPose, matrix_from_wxyz
from sitl.scenario.schema import Scenario

MOVES_FASTER_THAN_M_S = 0.5
MOVES_HIGHER_THAN_M = 0.8
"""The drone flies its pattern when it goes sideways faster and higher than this."""
TURNS_FASTER_THAN_RAD_S = math.radians(12.0)
"""Seen over `TURN_S`: more than wind and hovering do."""
TURN_S = 0.25


def body_from_camera(tilt_down_rad: float) -> Vector:
    """(3, 3): camera axes (x right, y down, z out) in the body's (forward, right, down)."""
    c, s = math.cos(tilt_down_rad), math.sin(tilt_down_rad)
    return np.array([[0.0, -s, c], [1.0, 0.0, 0.0], [0.0, c, s]])


def level_world_from_body_wxyz(heading_rad: float) -> Vector:
    """(4,): attitude of a level aircraft that heads so, ENU from forward-right-down."""
    # Forward = (sin h, cos h, 0), right = (cos h, -sin h, 0), down = (0, 0, -1): a half turn about a horizontal axis.
    half = 0.5 * (0.5 * math.pi - heading_rad)
    return np.array([0.0, math.cos(half), math.sin(half), 0.0])


def flies_sideways(truth: VehicleTruth) -> bool:
    """Whether the aircraft is in the air and moves to its left or right (the lateral pattern)."""
    right = matrix_from_wxyz(truth.world_from_body_wxyz)[:2, 1]
    length = float(np.hypot(*right))
    if length < 1e-6 or truth.position_enu_m[2] <= MOVES_HIGHER_THAN_M:
        return False
    return abs(float(truth.velocity_enu_m_s[:2] @ right)) / length > MOVES_FASTER_THAN_M_S


def turns(before: VehicleTruth, now: VehicleTruth) -> bool:
    """Whether the aircraft is in the air and its nose turned between two times."""
    if now.position_enu_m[2] <= MOVES_HIGHER_THAN_M or now.t_s <= before.t_s:
        return False
    noses = [matrix_from_wxyz(truth.world_from_body_wxyz)[:2, 0] for truth in (before, now)]
    angle = math.atan2(noses[0][0] * noses[1][1] - noses[0][1] * noses[1][0], float(noses[0] @ noses[1]))
    return abs(angle) > TURNS_FASTER_THAN_RAD_S * (now.t_s - before.t_s)


class CameraOnAirframe:
    """The lens' pose from the truth of the flight."""

    def __init__(self, scenario: Scenario, ring: TruthRing) -> None:
        self._ring = ring
        tilt_down_deg = scenario.camera.tilt_down_deg if scenario.gimbal is None else 0.0
        self._body_from_camera = body_from_camera(math.radians(tilt_down_deg))
        self._position_body_m = np.array(scenario.camera.position_body_m)
        heading = math.radians(scenario.vehicle.heading_deg)
        self._parked = VehicleTruth(0.0, np.zeros(3), np.zeros(3), level_world_from_body_wxyz(heading))

    def pose_at(self, t_s: float) -> CameraPose:
        """The lens' pose at a time; the oldest or newest known where the truth does not reach, parked before any."""
        truth = self._ring.at(t_s) or self._ring.newest() or self._parked
        return self.mounted(truth)

    def mounted(self, truth: VehicleTruth) -> CameraPose:
        """The lens' pose on an aircraft."""
        world_from_body = matrix_from_wxyz(truth.world_from_body_wxyz)
        carrier = world_from_body
        if truth.world_from_gimbal_wxyz is not None:
            carrier = matrix_from_wxyz(truth.world_from_gimbal_wxyz)
        return CameraPose(
            truth.position_enu_m + world_from_body @ self._position_body_m, carrier @ self._body_from_camera
        )
