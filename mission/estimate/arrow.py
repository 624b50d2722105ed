"""Solve the normal equations of one chain of states plus a few constants: block tridiagonal with a border ("arrow").

    [ H_cc  H_cb ] [ chain  ]   [ g_c ]
    [ H_bc  H_bb ] [ border ] = [ g_b ]

H_cc is block tridiagonal, so it is banded and LAPACK's banded Cholesky (pbtrf) factors it at a cost linear in the
number of blocks; the border follows by its Schur complement (Golub & Van Loan, Matrix Computations, 4.3 and 3.4.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from mission.records import Matrix, Vector


class NotPositiveDefinite(ArithmeticError):
    """The normal equations have no unique solution: something in them is not observable."""


@dataclass(frozen=True, slots=True, eq=False)
class Factored:
    """The factored arrow: what is needed to solve it and to know the border's covariance."""

    band: Matrix
    """Lower banded Cholesky factor of H_cc."""
    coupling: Matrix
    """L^-1 [H_cb, extra], shape (n * b, m)."""
    schur: Matrix
    """Lower Cholesky factor of the border's information with the chain eliminated, (m, m)."""

    def solve(self, chain: Vector, border: Vector) -> tuple[Vector, Vector]:
        """Chain (n * b,) and border (m,) that solve the equations for the right-hand side."""
        half, _ = lapack.dtbtrs(self.band, chain, uplo="L")
        half = half.reshape(-1)
        reduced = border - self.coupling.T @ half
        solution, _ = lapack.dpotrs(self.schur, reduced, lower=1)
        rest, _ = lapack.dtbtrs(self.band, half - self.coupling @ solution, uplo="L", trans="T")
        return rest.reshape(-1), solution

    def border_covariance(self) -> Matrix:
        """Inverse of the border's Schur complement, (m, m)."""
        inverse, info = lapack.dpotrs(self.schur, np.eye(len(self.schur)), lower=1)
        if info != 0:
            raise NotPositiveDefinite("the border's information is singular")
        return np.asarray(0.5 * (inverse + inverse.T))

    def chain_covariance(self, elements: NDArray[np.intp]) -> tuple[Matrix, Matrix]:
        """Covariance (k, k) of some elements of the chain, and theirs with the border (k, m)."""
        unit = np.zeros((self.band.shape[1], len(elements)))
        unit[elements, np.arange(len(elements))] = 1.0
        half, _ = lapack.dtbtrs(self.band, unit, uplo="L")
        cross = half.T @ self.coupling
        border = self.border_covariance()
        return half.T @ half + cross @ border @ cross.T, -cross @ border


def factor(diagonal: Matrix, below: Matrix, coupling: Matrix, border: Matrix) -> Factored:
    """Factor the arrow.

    Args:
        diagonal: diagonal blocks of H_cc, (n, b, b).
        below: blocks below them, (n - 1, b, b), row the later block.
        coupling: H_cb, (n * b, m).
        border: H_bb, (m, m).

    Raises:
        NotPositiveDefinite: the matrix is singular or not finite.
    """
    band, info = lapack.dpbtrf(_band(diagonal, below), lower=1, overwrite_ab=1)
    if info != 0:
        raise NotPositiveDefinite("the chain's information is singular")
    half, _ = lapack.dtbtrs(band, coupling, uplo="L")
    schur, info = lapack.dpotrf(border - half.T @ half, lower=1, clean=1)
    if info != 0:
        raise NotPositiveDefinite("the border's information is singular")
    if not math.isfinite(float(band[0].sum()) + float(schur.trace())):
        raise NotPositiveDefinite("the information is not finite")
    return Factored(band, half, schur)


def _band(diagonal: Matrix, below: Matrix) -> Matrix:
    """LAPACK's lower band storage: element (r, c) of the matrix at row r - c, column c; (2 b, n * b)."""
    count, size = diagonal.shape[:2]
    columns = np.zeros((count, 3 * size, size))
    columns[:, :size] = diagonal
    columns[:-1, size : 2 * size] = below
    taken: Matrix = columns.reshape(count, -1).take(_shift(size), axis=1).reshape(count * size, 2 * size)
    return taken.T  # Fortran order, as LAPACK wants it


@lru_cache(maxsize=8)
def _shift(size: int) -> NDArray[np.intp]:
    """Where each element of a block column's band storage stands in its stacked blocks, (size * 2 size,)."""
    column, row = np.meshgrid(np.arange(size), np.arange(2 * size), indexing="ij")
    return ((column + row) * size + column).reshape(-1)
