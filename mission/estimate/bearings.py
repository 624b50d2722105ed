"""Horizontal bearings: what the closed forms work with, and the estimate that a closed form can give.

With c_k the camera's place in the horizontal plane and n_k the unit normal of the bearing (n_k . b_k = 0), a target
at p(t_k) is on the bearing's line when n_k . p(t_k) = n_k . c_k. For a target that moves linearly this is linear in
what is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.observations import Observations, observe
from mission.records import Estimate, FirstPosition, FlightSightings, Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class Bearings:
    """Lines of sight, split into their horizontal and their vertical part."""

    seen: Observations
    place: Matrix
    """(n, 2), camera, relative to the reference."""
    along: Matrix
    """(n, 2), unit, horizontal direction to the target."""
    normal: Matrix
    """(n, 2), `along` turned counter-clockwise by a quarter."""
    slope: Vector
    """(n,), tangent of the elevation."""

    def side_m(self) -> Vector:
        """How far each camera place is to the side of the first line of sight, (n,), positive to the left."""
        return np.asarray((self.place - self.place[0]) @ self.normal[0])


def bearings(flight: FlightSightings, least: int) -> Bearings:
    """The flight's bearings.

    Args:
        flight: its noise model is not used.
        least: how many sightings are needed.

    Raises:
        EstimateRefused: there are fewer.
    """
    seen = observe(flight)
    if len(seen.t_s) < least:
        raise EstimateRefused(
            f"{len(seen.t_s)} usable sightings are too few", f"Keep the target in view for {least} sightings or more."
        )
    rays = np.column_stack((seen.measured[:, :2], np.ones(len(seen.t_s))))
    world = np.matmul(rays[:, None, :], seen.camera_from_world)[:, 0]
    length = np.hypot(world[:, 0], world[:, 1])
    if not np.all(length > 1e-9):
        raise EstimateRefused("The target is straight below or above", "Fly further away from it.")
    along = world[:, :2] / length[:, None]
    return Bearings(
        seen, seen.camera_m[:, :2], along, np.column_stack((-along[:, 1], along[:, 0])), world[:, 2] / length
    )


def closed_form_estimate(
    flight: FlightSightings,
    lines: Bearings,
    used: tuple[int, ...],
    first: Vector,
    velocity: Vector | None,
    *,
    method: str,
    model: str,
    notes: tuple[str, ...],
) -> Estimate:
    """The estimate of a closed form: a place and perhaps a velocity, without a covariance.

    Args:
        flight: the sightings.
        lines: its bearings.
        used: rows of the sightings that the closed form used, the first of them the earliest.
        first: horizontal target position at the first sighting, (2,), relative to the reference.
        velocity: horizontal, (2,), or None where the target is taken as standing.
        method: name of the method.
        model: what it assumed of the motion.
        notes: its assumptions in words.

    Raises:
        EstimateRefused: the target would be behind the camera.
    """
    seen = lines.seen
    moved = np.zeros(2) if velocity is None else velocity
    ranges = np.array([lines.along[k] @ (first + seen.t_s[k] * moved - lines.place[k]) for k in used])
    if not np.all(ranges > 0.0):
        raise EstimateRefused(
            "The lines of sight meet behind the camera",
            f"The target does not move as {method} assumes; use --method batch, or fly again.",
        )
    # The height is where the last line of sight that was used passes over the place.
    up = seen.camera_m[used[-1], 2] + lines.slope[used[-1]] * ranges[-1]
    last = flight.sightings[-1].t_s
    unknown = np.full((3, 3), np.nan)
    return Estimate(
        id=flight.id,
        method=method,
        model=model,
        t_s=last,
        position_enu_m=seen.reference_m + np.append(first + (last - seen.start_s) * moved, up),
        velocity_enu_m_s=None if velocity is None else np.append(velocity, 0.0),
        covariance=None,
        first=FirstPosition(flight.sightings[0].t_s, seen.reference_m + np.append(first, up), unknown),
        depth_m=float(np.hypot(*(first - lines.place[0]))),
        sightings=len(flight.sightings),
        rejected=0,
        chi2=None,
        dof=None,
        notes=notes,
    )
