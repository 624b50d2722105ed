"""Simulated procedures of several sidesteps: one aircraft, one target that changes its mind in between.

All passes share what a procedure shares: heading and tilt bias, the random walk of the reported position, the person's
size. Within a pass the velocity is constant; in the gaps it wanders by white-noise acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mission.records import NoiseModel, TargetPrior, Vector
from sitl.evaluation.accuracy.flights import Pattern, SimulatedFlight, Walk, simulate


def repeated_passes(
    pattern: Pattern,
    gaps_s: Sequence[float],
    walk: Walk,
    rng: np.random.Generator,
    *,
    between_psd_m2_s3: float,
    noise: NoiseModel | None = None,
    prior: TargetPrior | None = None,
) -> list[SimulatedFlight]:
    """One pass more than there are gaps; their ids are "1", "2" and so on.

    Args:
        pattern: flown in each pass, from the same place.
        gaps_s: between the last sighting of a pass and the first of the next.
        walk: the target in the first pass.
        rng: all randomness.
        between_psd_m2_s3: white-noise acceleration in the gaps, per horizontal axis.
        noise: the errors that are made, and stated.
        prior: what the flights state of the target.
    """
    starts = np.concatenate(([0.0], np.cumsum([pattern.t_s[-1] + gap for gap in gaps_s])))
    times = np.concatenate([start + pattern.t_s for start in starts])
    whole = Pattern(pattern.name, times, np.tile(pattern.left_ahead_up_m, (len(starts), 1)), pattern.heading_on_target)
    count = len(pattern.t_s)
    psd: Vector = np.zeros(len(times) - 1)
    psd[count - 1 :: count] = between_psd_m2_s3
    sim = simulate(whole, walk, rng, noise=noise, prior=prior, step_psd_m2_s3=psd)
    return [_part(sim, slice(k * count, (k + 1) * count), str(k + 1)) for k in range(len(starts))]


def _part(sim: SimulatedFlight, rows: slice, name: str) -> SimulatedFlight:
    flight = replace(sim.flight, id=name, sightings=sim.flight.sightings[rows])
    return SimulatedFlight(flight, sim.target_m[rows], sim.velocity_m_s[rows], sim.camera_m[rows], sim.wrong[rows])
