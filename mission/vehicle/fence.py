"""The autopilot's geofence in the local frame: a cylinder around home, and the areas of a fence plan."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.records import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class FenceArea:
    """A polygon or a circle of a fence plan, to stay inside of or to keep out of."""

    inclusion: bool
    corners_ne_m: Matrix
    """(corners, 2) north and east in the local frame, three or more; of a circle its centre alone."""
    radius_m: float = 0.0
    """Of a circle."""

    @property
    def shape(self) -> str:
        """In the operator's words."""
        return "circle" if len(self.corners_ne_m) == 1 else "polygon"

    def inside_m(self, points_ne_m: Matrix) -> Vector:
        """How far inside its edge points (n, 2) lie, (n,) m; outside: negative."""
        if len(self.corners_ne_m) == 1:
            circle: Vector = self.radius_m - np.linalg.norm(points_ne_m - self.corners_ne_m[0], axis=1)
            return circle
        start, end = self.corners_ne_m, np.roll(self.corners_ne_m, -1, axis=0)
        edge = end - start
        length_2 = np.maximum(np.sum(edge**2, axis=1), 1e-12)
        off = points_ne_m[:, None, :] - start
        along = np.clip(np.sum(off * edge, axis=2) / length_2, 0.0, 1.0)
        away = np.linalg.norm(off - along[:, :, None] * edge, axis=2).min(axis=1)
        # Even-odd rule: edges that a ray towards the north crosses.
        north, east = points_ne_m[:, 0, None], points_ne_m[:, 1, None]
        astride = (start[:, 1] > east) != (end[:, 1] > east)
        run = np.where(edge[:, 1] == 0.0, 1.0, edge[:, 1])
        crossed = astride & (north < start[:, 0] + (east - start[:, 1]) / run * edge[:, 0])
        signed: Vector = np.where(np.count_nonzero(crossed, axis=1) % 2 == 1, away, -away)
        return signed


@dataclass(frozen=True, slots=True, eq=False)
class Fence:
    """The autopilot's geofence: a cylinder around home, and areas."""

    centre_ned_m: Vector
    """(2,) north and east of the cylinder's axis in the local frame."""
    radius_m: float = math.inf
    min_height_m: float = -math.inf
    max_height_m: float = math.inf
    areas: tuple[FenceArea, ...] = ()
    any_inclusion: bool = False
    """One of the areas to stay inside of is enough; else all of them count."""

    def outside(self, position_ned_m: Vector, ground_down_m: float, margin_m: float) -> str | None:
        """How a position (3,) lies outside, or less than the margin inside; None when it does not."""
        return self.first_outside(position_ned_m[None, :], ground_down_m, margin_m)

    def first_outside(self, positions_ned_m: Matrix, ground_down_m: float, margin_m: float) -> str | None:
        """How the first of positions (n, 3) lies outside, or less than the margin inside; None when none does."""
        away = np.hypot(*(positions_ned_m[:, :2] - self.centre_ned_m).T)
        height = ground_down_m - positions_ned_m[:, 2]
        kept = f", of which {margin_m:.1f} m are kept free"
        beyond = _first(~(away <= self.radius_m - margin_m))
        if beyond is not None:
            return f"{away[beyond]:.1f} m from home, the autopilot's geofence is at {self.radius_m:.1f} m{kept}"
        above = _first(~(height <= self.max_height_m - margin_m))
        if above is not None:
            return f"height {height[above]:.1f} m, the autopilot's geofence is at {self.max_height_m:.1f} m{kept}"
        below = _first(~(height >= self.min_height_m))
        if below is not None:
            return f"height {height[below]:.1f} m, the autopilot's geofence begins at {self.min_height_m:.1f} m"
        return next(self._outside_areas(positions_ned_m[:, :2], margin_m), None)

    def _outside_areas(self, points_ne_m: Matrix, margin_m: float) -> Iterator[str]:
        kept = f", {margin_m:.1f} m are kept free"
        inclusions = [area for area in self.areas if area.inclusion]
        if self.any_inclusion and len(inclusions) > 1:
            inside = np.max([area.inside_m(points_ne_m) for area in inclusions], axis=0)
            first = _first(~(inside >= margin_m))
            if first is not None:
                yield f"{_side(inside[first])} every area that the autopilot's geofence allows{kept}"
        else:
            for area in inclusions:
                inside = area.inside_m(points_ne_m)
                first = _first(~(inside >= margin_m))
                if first is not None:
                    yield f"{_side(inside[first])} the {area.shape} that the autopilot's geofence allows{kept}"
        for area in self.areas:
            if area.inclusion:
                continue
            inside = area.inside_m(points_ne_m)
            first = _first(~(inside <= -margin_m))
            if first is not None:
                yield f"{_side(inside[first])} a {area.shape} that the autopilot's geofence forbids{kept}"


def _first(wrong: NDArray[np.bool_]) -> int | None:
    return int(np.argmax(wrong)) if bool(np.any(wrong)) else None


def _side(inside_m: float) -> str:
    return f"{abs(inside_m):.1f} m {'inside' if inside_m >= 0.0 else 'outside'}"
