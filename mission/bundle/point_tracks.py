"""Points of the picture followed from frame to frame: a corner to a cell, pyramidal Lucas-Kanade there and back.

Corners are the points with the largest smaller eigenvalue of the gradient's covariance (Shi & Tomasi 1994); each cell
of a coarse grid without a point gets its best one, so that near ground and far houses both have some, and each cell of
a fine one its best if it is good. A point is followed until the way back does not lead to where it came from (Kalal,
Mikolajczyk & Matas 2010), or it enters a box that is left out; where the camera comes past again it is taken up again
(`mission.bundle.loop_closure`), and so that it does not drift it is held to its first look
(`mission.bundle.patch_alignment`).
Everything is kept until the flight is over; what moves by itself is told apart afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.bundle.loop_closure import SeenPatches
from mission.bundle.patch_alignment import PatchAlignment
from mission.records import Box, CameraIntrinsics, Frame, Image, Matrix

_WORK_WIDTH_PX = 320
"""At least: at 284 of an AR.Drone's 853 the heading came out half as well as at 426."""
_CELL_PX = 30
"""Side of a grid cell, work pixels."""
_WINDOW = (16, 15)
"""Across and down. OpenCV takes eight pixels across at once and the rest one by one: 15 across take twice the time."""
_LEVELS = 3
_BACK_ERROR_PX = 0.4
"""Work pixels between a point and where the way there and back ends."""
_LEAST_EIGENVALUE = 4e-5
"""Of a corner: contrast of about 1.5 grey levels a pixel in its weaker direction, above the video's noise."""
_SMALL_CELL_PX = 15
_GOOD_EIGENVALUE = 3e-4
"""Of a corner that is followed besides: each point drifts by its own, so many are better than few."""
_APART_PX = 5.0
"""Work pixels that a new corner keeps from the points that there are."""
_REFILL_EVERY = 3
_LOOK_BACK_EVERY = 4
_SAME_PX = 3.0
"""Work pixels between two points of the same thing."""
_EDGE_PX = 6
_LEVELS_BACK = 1
"""The way back begins where most points were, so it is short."""
_STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)
_GROWN = 0.25
"""By which a person's box is grown on each side, as a share of its width: arms, shadow at the feet, a loose box."""
MAX_FRAMES = 6000
"""Frames that are kept; five minutes of video at 20 frames a second, longer than any pattern that is worth flying."""

Points = NDArray[np.float32]
"""(n, 2)."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackedFrame:
    """One frame and the points that were found in it."""

    t_s: float
    """The frame's own time, as the video tells it."""
    grey: Image
    """(h, w), work size."""
    track: NDArray[np.int32]
    """(n,) which track each point belongs to, ascending."""
    point: Points
    """(n, 2) work pixels of the levelled picture, counted from the middle of the first one as OpenCV does."""
    roll_rad: float
    """By how much the picture was turned to level it."""


class PointTracker:
    """Follows points through the frames of one sidestep.

    Args:
        intrinsics: of the frames.
    """

    def __init__(self, intrinsics: CameraIntrinsics) -> None:
        self.scale = max(1, intrinsics.width_px // _WORK_WIDTH_PX)
        """Picture pixels per work pixel."""
        self._size = intrinsics.width_px // self.scale, intrinsics.height_px // self.scale
        self.frames: list[TrackedFrame] = []
        self._next = 0
        self._album = SeenPatches(self._size)
        self._anchors = PatchAlignment()

    def add(self, frame: Frame, left_out: Sequence[Box] = (), roll_rad: float = 0.0) -> None:
        """Follow the points into the next frame.

        The picture is levelled first: an aircraft banks by 10 degrees and more on its way, and a window that turns
        moves the point by what its texture lies beside the middle, a pixel or so.

        Args:
            frame: BGR; frames that are not later than the last one, or beyond `MAX_FRAMES`, are passed over.
            left_out: boxes around things that move.
            roll_rad: of the camera about its optical axis, positive with the right side of the picture down.
        """
        if len(self.frames) >= MAX_FRAMES or (self.frames and frame.t_s <= self.frames[-1].t_s):
            return
        small = frame.image if self.scale == 1 else cv2.resize(frame.image, self._size, interpolation=cv2.INTER_AREA)
        level = self._level(roll_rad)
        tilted = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
        grey: Image = np.asarray(
            cv2.warpAffine(tilted, level, self._size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8
        )
        wanted = np.asarray(
            cv2.warpAffine(self._wanted(left_out), level, self._size, flags=cv2.INTER_NEAREST), np.uint8
        )
        track, point = np.empty(0, dtype=np.int32), np.empty((0, 2), dtype=np.float32)
        if self.frames:
            last = self.frames[-1]
            there, found = follow(last.grey, grey, last.point, last.point)
            found &= _inside(there, wanted)
            track, point = last.track[found], there[found]
        if len(self.frames) % _LOOK_BACK_EVERY == 0:
            track, point = self._seen_again(grey, frame.t_s, wanted, track, point)
        point = self._anchors.refined(grey, track, point)
        if len(self.frames) % _REFILL_EVERY == 0 or len(point) < wanted.size // (8 * _CELL_PX**2):
            fresh = _corners(grey, point, wanted)
            track = np.concatenate([track, np.arange(self._next, self._next + len(fresh), dtype=np.int32)])
            point = np.concatenate([point, fresh])
            self._anchors.begin(grey, fresh)
            self._next += len(fresh)
        self.frames.append(TrackedFrame(frame.t_s, grey, track, point, roll_rad))

    def _seen_again(
        self, grey: Image, t_s: float, wanted: NDArray[np.uint8], track: NDArray[np.int32], point: Points
    ) -> tuple[NDArray[np.int32], Points]:
        """The points with those that are found again from an earlier picture; each takes over from a new one there."""
        twin = self._album.look(grey, t_s, len(self.frames))
        if twin is None:
            return track, point
        old = self.frames[twin.number]
        gone = ~np.isin(old.track, track)
        start = old.point[gone]
        guess = np.asarray(start + np.array(twin.shift), dtype=np.float32)
        likely = _inside(guess, wanted)
        there, found = follow(old.grey, grey, start[likely], guess[likely])
        found &= _inside(there, wanted)
        again, there = old.track[gone][likely][found], there[found]
        if len(again) == 0:
            return track, point
        taken_over = (_near(point, there, _SAME_PX) & (track[:, None] > again[None])).any(axis=1)
        track, point = np.concatenate([track[~taken_over], again]), np.concatenate([point[~taken_over], there])
        order = np.argsort(track, kind="stable")
        return track[order], point[order]

    def pixels(self, frame: TrackedFrame, points: Points) -> Matrix:
        """Picture pixels, (0, 0) = outer corner of the top left one, of work pixels (n, 2) of a frame."""
        back = cv2.invertAffineTransform(self._level(frame.roll_rad))
        return np.asarray((points @ back[:, :2].T + back[:, 2] + 0.5) * self.scale, dtype=np.float64)

    def points(self, frame: TrackedFrame, pixels: Matrix) -> Points:
        """The other way round."""
        level = self._level(frame.roll_rad)
        return np.asarray((pixels / self.scale - 0.5) @ level[:, :2].T + level[:, 2], dtype=np.float32)

    def _level(self, roll_rad: float) -> Matrix:
        """(2, 3): from the picture to the levelled one, work pixels."""
        width, height = self._size
        middle = (0.5 * (width - 1), 0.5 * (height - 1))
        return np.asarray(cv2.getRotationMatrix2D(middle, -math.degrees(roll_rad), 1.0), dtype=np.float64)

    def _wanted(self, left_out: Sequence[Box]) -> NDArray[np.uint8]:
        """(h, w): 255 where points may be."""
        width, height = self._size
        mask = np.zeros((height, width), dtype=np.uint8)
        mask[_EDGE_PX:-_EDGE_PX, _EDGE_PX:-_EDGE_PX] = 255
        for box in left_out:
            grown = _GROWN * box.width_px
            left, right = ((x / self.scale) for x in (box.left_px - grown, box.right_px + grown))
            top, bottom = ((y / self.scale) for y in (box.top_px - grown, box.bottom_px + grown))
            across, down = np.clip([left, right], 0, width).astype(int), np.clip([top, bottom], 0, height).astype(int)
            mask[down[0] : down[1], across[0] : across[1]] = 0
        return mask


def follow(before: Image, now: Image, start: Points, guess: Points) -> tuple[Points, NDArray[np.bool_]]:
    """Where points of one picture are in another, and whether that is to be believed.

    Args:
        before: (h, w) picture in which the points are known.
        now: (h, w) picture in which they are looked for.
        start: (n, 2), the points in `before`.
        guess: (n, 2), about where they are in `now`.

    Returns:
        (n, 2) points, (n,) True where the way back ends where it began.
    """
    if len(start) == 0:
        return start.copy(), np.zeros(0, dtype=bool)
    # The eigenvalue is there already; the windows' difference, which would be told instead, takes a fifth more.
    flags = cv2.OPTFLOW_USE_INITIAL_FLOW | cv2.OPTFLOW_LK_GET_MIN_EIGENVALS
    began = np.ascontiguousarray(start, dtype=np.float32).reshape(-1, 1, 2)
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, began, np.ascontiguousarray(guess, dtype=np.float32).reshape(-1, 1, 2).copy(),
        winSize=_WINDOW, maxLevel=_LEVELS, criteria=_STOP, flags=flags,
    )  # fmt: skip
    # Back from where most points moved, not from each one's own beginning, which would find itself.
    blind = there - np.median(there - began, axis=0)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(
        now, before, there, blind, winSize=_WINDOW, maxLevel=_LEVELS_BACK, criteria=_STOP, flags=flags
    )
    error = np.abs(back - began).reshape(-1, 2).max(axis=1)
    good = (found.ravel() == 1) & (returned.ravel() == 1) & (error < _BACK_ERROR_PX)
    return np.asarray(there.reshape(-1, 2), dtype=np.float32), good


def _inside(points: Points, wanted: NDArray[np.uint8]) -> NDArray[np.bool_]:
    height, width = wanted.shape
    column, row = np.rint(np.nan_to_num(points, nan=-1.0)).astype(int).T
    inside: NDArray[np.bool_] = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    inside[inside] = wanted[row[inside], column[inside]] > 0
    return inside


def _corners(grey: Image, taken: Points, wanted: NDArray[np.uint8]) -> Points:
    """The best corner (n, 2) of each large cell that has no point yet, and then good ones of small cells."""
    strength = np.asarray(cv2.cornerMinEigenVal(grey, 5), dtype=np.float32)
    strength[wanted == 0] = 0.0
    some = _best_of_cells(strength, taken, _CELL_PX, _LEAST_EIGENVALUE)
    more = _best_of_cells(strength, np.concatenate([taken, some]), _SMALL_CELL_PX, _GOOD_EIGENVALUE)
    return np.concatenate([some, more])


def _best_of_cells(strength: NDArray[np.float32], taken: Points, cell_px: int, least: float) -> Points:
    """The strongest pixel (n, 2) of each cell without a point, where it is strong enough and no point is near."""
    rows, columns = strength.shape[0] // cell_px, strength.shape[1] // cell_px
    grid = strength[: rows * cell_px, : columns * cell_px].reshape(rows, cell_px, columns, cell_px)
    cells = np.asarray(grid.transpose(0, 2, 1, 3).reshape(rows * columns, -1))
    best = cells.argmax(axis=1)
    good = cells[np.arange(len(cells)), best] > least
    across = np.clip((taken[:, 0] // cell_px).astype(int), 0, columns - 1)
    down = np.clip((taken[:, 1] // cell_px).astype(int), 0, rows - 1)
    good[down * columns + across] = False
    cell = np.flatnonzero(good)
    row, column = cell // columns * cell_px + best[cell] // cell_px, cell % columns * cell_px + best[cell] % cell_px
    found = np.stack([column, row], axis=1).astype(np.float32)
    alone = ~_near(found, taken, _APART_PX).any(axis=1)
    return np.asarray(found[alone], dtype=np.float32)


def _near(some: Points, others: Points, limit: float) -> NDArray[np.bool_]:
    """(n, m): which of some points (n, 2) and others (m, 2) are less than this apart, both across and down."""
    across, down = np.abs(some.T[:, :, None] - others.T[:, None])
    return np.asarray((across < limit) & (down < limit))
