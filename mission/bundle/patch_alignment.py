"""What each point looked like at first: where that is seen again, a point does not drift.

Followed from frame to frame, a point adds up the errors of every step, half a pixel a second and all to one side, and
many points that wander while the camera goes out and back are a world at another distance under a camera that turns. So
after each step the point is put where its surroundings look most as they did in the first frame (Lucas-Kanade in the
inverse compositional form, Baker & Matthews 2004: the derivatives are those of the first look, and are reckoned once).
Looks are compared without their mean and in units of their contrast, so the exposure may wander. Where the first look
is not recognised any more (another side of a thing, another distance), the point stays where following brought it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.records import Image

_HALF = 5
"""Of a look's side, work pixels. On rendered flights 4 to 6 were as good; 7 had a half larger error in heading."""
_SOFT_PX = 3.5
"""Standard deviation of the weight about the middle."""
_STEPS = 2
_MOST_STEP_PX = 1.0
_FARTHEST_PX = 2.0
"""From where following brought the point: what is farther away is something else."""
_LEAST_LIKENESS = 0.8
"""Correlation of two looks that are the same thing."""
_LEAST_CONTRAST = 1e-3
"""Grey levels."""
_FLAT = 1e-6
"""Added to the looks' information, which is 1/px^2 for a good corner."""

_WAYS = np.eye(2, dtype=np.float32)

Looks = NDArray[np.float32]
"""(n, s): pixels of n looks, one row each."""
Points = NDArray[np.float32]
"""(n, 2), work pixels."""


class PatchAlignment:
    """The first looks of points, by the number of their track."""

    def __init__(self) -> None:
        side = np.arange(-_HALF, _HALF + 1, dtype=np.float32)
        down, across = (one.ravel() for one in np.meshgrid(side, side, indexing="ij"))
        self._across, self._down = across, down
        weight = np.exp(-0.5 * (across**2 + down**2) / _SOFT_PX**2)
        self._weight = np.asarray(weight / weight.sum(), dtype=np.float32)
        self._look = np.empty((0, len(weight)), dtype=np.float32)
        self._step = np.empty((0, 2, len(weight)), dtype=np.float32)
        """What a difference of looks says of the place: (2, s) per point, pixels."""

    def begin(self, grey: Image, points: Points) -> None:
        """Remember what new points look like; they are numbered on.

        Args:
            grey: (h, w).
            points: (n, 2) in it.
        """
        if len(points) == 0:
            return
        picture = np.asarray(grey, dtype=np.float32)
        look, contrast = self._normal(self._cut(picture, points))
        slope = np.stack(
            [0.5 * (self._cut(picture, points + way) - self._cut(picture, points - way)) for way in _WAYS], axis=1
        )
        # What the mean over the look changes by is not seen.
        slope = (slope - (slope @ self._weight)[..., None]) / contrast[:, None, None]
        information = np.einsum("nas,nbs,s->nab", slope, slope, self._weight) + _FLAT * np.eye(2, dtype=np.float32)
        step = np.linalg.inv(information) @ slope * self._weight
        self._look = np.concatenate([self._look, look])
        self._step = np.concatenate([self._step, np.asarray(step, dtype=np.float32)])

    def refined(self, grey: Image, track: NDArray[np.int32], points: Points) -> Points:
        """Where points look most as they did at first; unchanged where they are not recognised.

        Args:
            grey: (h, w).
            track: (n,) numbers of the points.
            points: (n, 2), where following brought them.
        """
        if len(points) == 0:
            return points
        picture = np.asarray(grey, dtype=np.float32)
        first, step = self._look[track], self._step[track]
        place = points
        for _ in range(_STEPS):
            look, _ = self._normal(self._cut(picture, place))
            moved = np.matmul(step, (look - first)[:, :, None])[:, :, 0]
            place = place - np.clip(moved, -_MOST_STEP_PX, _MOST_STEP_PX)
        likeness = np.einsum("ns,ns,s->n", look, first, self._weight)
        known = (likeness > _LEAST_LIKENESS) & (np.abs(place - points).max(axis=1) < _FARTHEST_PX)
        return np.where(known[:, None], place, points)

    def _cut(self, picture: NDArray[np.float32], points: Points) -> Looks:
        """The surroundings of points."""
        across, down = points[:, :1] + self._across, points[:, 1:] + self._down
        return np.asarray(
            cv2.remap(picture, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32
        )

    def _normal(self, looks: Looks) -> tuple[Looks, NDArray[np.float32]]:
        """Looks of mean nought and contrast one, and their contrasts (n,)."""
        plain = looks - (looks @ self._weight)[:, None]
        contrast = np.maximum(np.sqrt(np.square(plain) @ self._weight), np.float32(_LEAST_CONTRAST))
        return np.asarray(plain / contrast[:, None], dtype=np.float32), np.asarray(contrast, dtype=np.float32)
