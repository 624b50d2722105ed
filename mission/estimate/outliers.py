"""Which sightings are somebody else: data snooping at the most probable state.

A blunder in one sighting is an extra unknown there. Its score is the gradient of the cost by it, (Q r)_i, and the
score divided by its own information is chi-square distributed when there is no blunder (Baarda 1968). The
information used is the local one, the sighting's own chain given its neighbours', which makes the test slightly too
kind.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mission.estimate.joint_model import JointModel, Linearised
from mission.records import Vector

PIXEL_LIMIT = 25.0
"""Chi-square, 2 degrees of freedom: a right sighting fails once in 270,000."""
SIZE_LIMIT = 22.0
"""Chi-square, 1 degree of freedom: a right height fails once in 370,000."""


def blunder_scores(model: JointModel, at: Linearised) -> tuple[Vector, Vector]:
    """Chi-square of a blunder in each sighting's place in the picture (2 dof) and in its height (1 dof), (n,) each."""
    score = model.weighted(at.residual[:, :, None])[:, :, 0]
    prior = np.einsum("nbb->nb", model.prior_diagonal)[:, : model.size_place]
    jacobian = at.chain_jacobian[:, :, : model.size_place]
    spread = np.einsum("nib,nb,njb->nij", jacobian, 1.0 / prior, jacobian)
    places = np.arange(3)
    spread[:, places, places] += 1.0 / model.precision
    pixel = np.einsum("ni,nij,nj->n", score[:, :2], spread[:, :2, :2], score[:, :2])
    size = np.where(model.has_size, score[:, 2] ** 2 * spread[:, 2, 2], 0.0)
    return pixel, size


def worst(scores: Vector, limit: float) -> NDArray[np.bool_]:
    """Scores above the limit that no neighbour's exceeds: a blunder spoils its neighbours' scores too."""
    padded = np.concatenate(([0.0], scores, [0.0]))
    return (scores > limit) & (scores >= padded[:-2]) & (scores >= padded[2:])


def plausible(model: JointModel, at: Linearised, limit: float = PIXEL_LIMIT) -> NDArray[np.bool_]:
    """Which sightings lie where their own errors alone, neighbours not asked, would put them, (n,)."""
    jacobian = at.chain_jacobian[:, :2, : model.size_place]
    spread = np.matmul(jacobian, np.swapaxes(jacobian, 1, 2))
    spread[:, [0, 1], [0, 1]] += 1.0
    residual = at.residual[:, :2]
    chi2: Vector = np.einsum("ni,ni->n", residual, np.linalg.solve(spread, residual[:, :, None])[:, :, 0])
    near: NDArray[np.bool_] = chi2 < limit
    return near
