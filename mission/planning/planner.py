"""Which pattern to fly for a wanted accuracy: the Cramer-Rao bound (`estimate/bound.py`), evaluated before take-off.

Candidates are the patterns of `pattern.py` that fit into the room: kind, time for each leg, and how often it is
repeated; each as long as room, speed, acceleration and the turning aircraft allow, for at the same time a longer
pattern shows the target under a larger angle. In order of their duration, each is judged by its worst case: the target
stands, or walks in one of eight directions. The first that reaches the wanted 1-sigma is the cheapest; it is then
shortened as far as that still holds, so that it is flown gently.

The bound is what no unbiased estimate can beat; `batch` comes within some 5 % of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count

from mission.errors import EstimateRefused, FlightRefused, SettingsError
from mission.planning.bound import PEAK_ACCELERATION, PEAK_SPEED, Judge, Outlook, Plan, duration_s
from mission.planning.pattern import LARGEST_SHARE
from mission.settings import PatternSettings
from mission.vehicle.drone import Bounds

PREPARATION_S = 20.0
"""What hovering, detection, turning and centring take of the time allowed before the pattern starts, generously."""
LEAST_LENGTH_M = 1.0
"""Shorter patterns are not flown (`pattern.fitted`)."""
LARGEST_ACCELERATION_M_S2 = 2.5
"""14 degrees of bank."""
LARGEST_TURN_RAD_S = 0.6
"""Share of the heading's rate that the pattern may use: half of what the aircraft turns; a walker needs some of it."""
NEARLY = 1.1
"""Times the best 1-sigma: the last tenth would take several times as long."""
PASSES = (1, 2, 3, 4, 6, 8, 10)
_SHORTEST_LEG_S, _LEG_RATIO, _LEG_STEP_S = 0.8, 1.12, 0.1
_LENGTH_STEP_M = 0.1


@dataclass(frozen=True, slots=True)
class SideRoom:
    """What a pattern may use, as seen by somebody who looks at the target."""

    left_m: float
    right_m: float
    height_m: float
    """Of the camera above the target's ground."""
    max_speed_m_s: float
    max_time_s: float
    """For the pattern alone."""

    @classmethod
    def within(
        cls,
        bounds: Bounds,
        height_m: float,
        *,
        left_m: float = math.inf,
        right_m: float = math.inf,
        max_speed_m_s: float | None = None,
        max_time_s: float | None = None,
    ) -> SideRoom:
        """What the bounds of a flight leave, where control is taken at the pattern's start.

        Args:
            bounds: of the flight.
            height_m: above home, which is taken as the height above the target's ground.
            left_m: room on the left, where there is less than the bounds'.
            right_m: room on the right.
            max_speed_m_s: where it is lower than the bounds'.
            max_time_s: for the pattern, where it is less than the bounds leave.

        Raises:
            SettingsError: a figure is not a number above 0.
            FlightRefused: the height is outside the bounds.
        """
        speed, time_s = bounds.max_speed_m_s, max(0.0, bounds.max_duration_s - PREPARATION_S)
        speed = speed if max_speed_m_s is None else min(speed, _positive("the largest speed", max_speed_m_s))
        time_s = time_s if max_time_s is None else min(time_s, _positive("the time", max_time_s))
        if not bounds.min_height_m <= height_m <= bounds.max_height_m:
            raise FlightRefused(
                f"{height_m:.1f} m is outside the heights allowed, "
                f"{bounds.min_height_m:.1f} to {bounds.max_height_m:.1f} m",
                "Plan for another height, or change the limits in the settings.",
            )
        return cls(min(left_m, bounds.radius_m), min(right_m, bounds.radius_m), height_m, speed, time_s)


@dataclass(frozen=True, slots=True)
class Shortfall:
    """The wanted accuracy cannot be had; what can, and what would help."""

    wanted_sigma_m: float
    best: Plan
    helps: tuple[str, ...]
    """Each is enough by itself."""

    def refusal(self) -> EstimateRefused:
        """As an error."""
        remedy = "Any of these would do: " + "; ".join(self.helps) if self.helps else "Ask for less, or go nearer"
        return EstimateRefused(
            f"{self.wanted_sigma_m:.2g} m cannot be had; the best is {self.best.worst_sigma_m:.2g} m", remedy + "."
        )


def plan(wanted_sigma_m: float, outlook: Outlook, room: SideRoom) -> Plan | Shortfall:
    """The shortest pattern within the room that reaches a wanted 1-sigma, whatever the target does.

    Args:
        wanted_sigma_m: of the horizontal distance at the first sighting.
        outlook: the target and how it is seen.
        room: the room there is.

    Returns:
        The plan, or how much short of the wanted the room falls.

    Raises:
        SettingsError: a figure is not positive, or not finite.
        FlightRefused: no pattern fits into the room.
        EstimateRefused: no pattern that fits determines the target at all.
    """
    found = _best(wanted_sigma_m, outlook, room)
    if found.worst_sigma_m <= wanted_sigma_m:
        return found
    return Shortfall(wanted_sigma_m, found, tuple(_helps(wanted_sigma_m, outlook, room)))


def plan_in_flight(wanted_sigma_m: float, outlook: Outlook, room: SideRoom) -> Plan:
    """The shortest pattern that reaches a wanted 1-sigma; where none does, the shortest that is nearly the best.

    Args:
        wanted_sigma_m: of the horizontal distance at the first sighting.
        outlook: the target and how it is seen.
        room: the room there is.

    Raises:
        SettingsError: a figure is not positive, or not finite.
        FlightRefused: no pattern fits into the room.
        EstimateRefused: no pattern that fits determines the target at all.
    """
    found = _best(wanted_sigma_m, outlook, room)
    if found.worst_sigma_m <= wanted_sigma_m:
        return found
    return _search(NEARLY * found.worst_sigma_m, outlook, room) or found


def _best(wanted_sigma_m: float, outlook: Outlook, room: SideRoom) -> Plan:
    """The shortest pattern that reaches the wanted sigma, or failing that the best one; raises as `plan` says."""
    _check(wanted_sigma_m, outlook, room)
    found = _search(wanted_sigma_m, outlook, room)
    if found is None:
        raise EstimateRefused("No pattern in this room determines the target's distance", "Give it more room or time.")
    return found


def _check(wanted_sigma_m: float, outlook: Outlook, room: SideRoom) -> None:
    _positive("the wanted sigma", wanted_sigma_m)
    _positive("the distance", outlook.distance_m)
    _positive("the frame rate", outlook.rate_hz)
    _positive("the height", room.height_m)
    _positive("the largest speed", room.max_speed_m_s)
    for name, value in (
        ("the walking speed", outlook.walk_m_s),
        ("the room on the left", room.left_m),
        ("the room on the right", room.right_m),
    ):
        if not 0.0 <= value < math.inf:
            raise SettingsError(f"{name} is {value:g}", "Give 0 or a number above it.")
    side_m = max(room.left_m, room.right_m)
    if not side_m >= LEAST_LENGTH_M:
        raise FlightRefused(f"there are only {side_m:.1f} m of room to the side", "Make room for 1 m at least.")
    if not outlook.distance_m * LARGEST_SHARE >= LEAST_LENGTH_M:
        raise FlightRefused(f"the target is too near ({outlook.distance_m:.1f} m)", "Keep 1.2 m away at least.")
    if next(_candidates(outlook, room), None) is None:
        raise FlightRefused(
            f"no pattern of 1 m fits into {room.max_time_s:.1f} s at {room.max_speed_m_s:.1f} m/s",
            "Allow more time or speed.",
        )


def _positive(name: str, value: float) -> float:
    if not 0.0 < value < math.inf:
        raise SettingsError(f"{name} is {value:g}", "Give a number above 0.")
    return value


def _search(wanted_sigma_m: float, outlook: Outlook, room: SideRoom, *, or_best: bool = True) -> Plan | None:
    """The shortest pattern that reaches the wanted sigma, or failing that the best one (or None)."""
    judge = Judge(outlook, room.height_m)
    best: PatternSettings | None = None
    best_sigma = math.inf if or_best else wanted_sigma_m
    for pattern in sorted(_candidates(outlook, room), key=lambda p: (duration_s(p), p.length_m)):
        sigma = judge.worst(pattern, best_sigma)
        if sigma <= wanted_sigma_m:
            return judge.expected(_gentlest(pattern, wanted_sigma_m, judge))
        if sigma < best_sigma:
            best, best_sigma = pattern, sigma
    return None if best is None else judge.expected(best)


def _candidates(outlook: Outlook, room: SideRoom) -> Iterator[PatternSettings]:
    """For each kind, leg time and number of passes the longest pattern that is allowed."""
    side = "left" if room.left_m >= room.right_m else "right"
    fits = LARGEST_SHARE * outlook.distance_m
    for kind, across in (("out-and-back", max(room.left_m, room.right_m)), ("s", min(room.left_m, room.right_m))):
        longest = _steps_down(min(fits, across, 50.0))
        for leg_s in _leg_times():
            speed = min(room.max_speed_m_s, LARGEST_TURN_RAD_S * outlook.distance_m)
            fast = speed * leg_s / (PEAK_SPEED * (1.0 if kind == "out-and-back" else math.sqrt(2.0)))
            strong = LARGEST_ACCELERATION_M_S2 * leg_s**2 / PEAK_ACCELERATION
            length = min(longest, _steps_down(min(fast, strong)))
            for passes in PASSES:
                if length >= LEAST_LENGTH_M:
                    pattern = PatternSettings.model_validate(
                        {"kind": kind, "length_m": length, "leg_duration_s": leg_s, "side": side, "passes": passes}
                    )
                    if duration_s(pattern) <= room.max_time_s:
                        yield pattern
            if length >= longest:
                break  # flying slower than need be lets the target walk further, and wins nothing


def _leg_times() -> Iterator[float]:
    """A fixed lattice, so that more room or time only ever adds candidates."""
    last = 0.0
    for k in count():
        leg_s = round(round(_SHORTEST_LEG_S * _LEG_RATIO**k / _LEG_STEP_S) * _LEG_STEP_S, 6)
        if leg_s > 60.0:
            return
        if leg_s > last:
            yield leg_s
        last = leg_s


def _gentlest(pattern: PatternSettings, wanted_sigma_m: float, judge: Judge) -> PatternSettings:
    """The pattern, shortened as far as it still reaches the wanted sigma."""
    low, high = round(LEAST_LENGTH_M / _LENGTH_STEP_M), round(pattern.length_m / _LENGTH_STEP_M)
    while low < high:
        middle = (low + high) // 2
        shorter = pattern.model_copy(update={"length_m": round(middle * _LENGTH_STEP_M, 6)})
        if judge.worst(shorter, wanted_sigma_m) <= wanted_sigma_m:
            high = middle
        else:
            low = middle + 1
    return pattern.model_copy(update={"length_m": round(high * _LENGTH_STEP_M, 6)})


def _steps_down(length_m: float) -> float:
    return round(math.floor(length_m / _LENGTH_STEP_M + 1e-9) * _LENGTH_STEP_M, 6)


def _helps(wanted_sigma_m: float, outlook: Outlook, room: SideRoom) -> Iterator[str]:
    """What would be enough to reach the wanted sigma, one thing at a time."""
    wider = max(2.0 * room.left_m, 2.0 * room.right_m)
    nearer = max(0.5 * outlook.distance_m, 1.01 * LEAST_LENGTH_M / LARGEST_SHARE)
    tries = (
        (f"{wider:.0f} m of room on both sides", outlook, replace(room, left_m=wider, right_m=wider)),
        (f"{2.0 * room.max_time_s:.0f} s of time", outlook, replace(room, max_time_s=2.0 * room.max_time_s)),
        (f"{2.0 * room.max_speed_m_s:.1f} m/s", outlook, replace(room, max_speed_m_s=2.0 * room.max_speed_m_s)),
        (f"a distance of {nearer:.1f} m", replace(outlook, distance_m=nearer), room),
    )
    for what, other, larger in tries:
        found = _search(wanted_sigma_m, other, larger, or_best=False)
        if found is not None:
            yield f"{what} ({found.pattern.kind}, {found.time_s:.0f} s)"
