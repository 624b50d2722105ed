"""Who is who among the people in view: several hypotheses, each with everybody in it, weighed by their likelihoods.

A small multiple hypothesis tracker (Reid 1979), in which what is asked is only which of the boxes is the target. Each
hypothesis is an assignment of boxes to people over time. At every look each grows branches: the best assignment for
every box that the target could be, and for its being hidden (linear assignment). Branches that agree about the target
are merged. The target is told where nearly all of the weight is on one box.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from mission.records import Matrix
from mission.track.appearance import Histogram, adapted, likeness
from mission.track.likeness import LikenessModel
from mission.track.walk import Seen, Walk

KEPT = 6
"""Hypotheses."""
_LEAST_WEIGHT = 1e-3
_NEWCOMER = math.log(0.02)
"""Log density of people who are seen for the first time, per body height squared and unit of log height."""
_SEEN = (0.9, 0.5)
"""Chance of being seen for who was seen in the last look, and for who was not."""
_COVERED = 0.3
"""The same for who is behind somebody nearer."""
_COVERING = 0.3
"""Sideways distance at which who is nearer covers who is farther, body heights."""
_GATE = -9.0
"""Log likelihood of place, height and colours below which two are not the same."""
_ALONE = 0.45
"""Distance, in body heights, at which another body takes nothing away from the colours."""
_BELIEVED_LOOKS = 6
_KEPT_S = (0.5, 3.0)
"""How long somebody unseen is kept who was seen in fewer looks than that, and who was seen in as many."""
_ADAPTED = 0.08
"""Share of a look in the memory of the colours."""
_NEAR = 2.0
"""Body heights within which somebody may be mistaken for the target."""
_STILL_NEAR_S = 1.0
"""How long somebody unseen may still be near."""
_AS_ALIKE = 1.5
"""Standard deviations below the target's usual likeness to itself to which they look like it."""
_GUESSED = (0.15, 0.3)
"""Standard deviations of place, body heights, and log height of who is cut off by the picture when first seen."""
_LIKE_TARGET = 1.0
"""Evidence of the colours from which on somebody may be the target where nothing else tells, nats."""
_LOOKS_S = 0.25
"""Looks nearer to each other than this tell the same about the colours, and count in part."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Somebody in a frame."""

    seen: Seen
    looks: Histogram
    tall_px: float
    """How tall they are, by a guess where the picture cuts them off."""


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """Somebody who is followed, in one hypothesis."""

    walk: Walk
    looks: Histogram
    seen_s: float
    times: int = 1
    """In how many looks they were seen."""
    missed: bool = False
    """In the last look."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Who is who; the first is the target."""

    weight: float
    people: tuple[Person, ...]
    box: int | None = None
    """Which of the last look's boxes the target is; None while it is hidden."""


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What a look says about the target."""

    box: int | None
    """The likeliest box; None if it is likelier hidden."""
    probability: float
    """Of that."""
    alike: float
    """Likeness of the colours in that box; 0 without one."""
    person: Person
    """The target, by the likeliest hypothesis."""
    others: tuple[Person, ...]
    """The others, by the same."""


class Crowd:
    """Everybody around the target.

    Args:
        target: seen for the first time.
        t_s: when.
    """

    def __init__(self, target: Body, t_s: float) -> None:
        self._hypotheses: list[Hypothesis] = [Hypothesis(1.0, (_newcomer(target, t_s),))]
        self._own, self._others = LikenessModel(), LikenessModel()
        self._look_s = t_s

    @property
    def best(self) -> Hypothesis:
        """The likeliest."""
        return self._hypotheses[0]

    def predict(self, dt_s: float, shift_px: tuple[float, float], passed: tuple[float, float]) -> None:
        """To the next frame (`Walk.predicted`)."""
        known: dict[int, Walk] = {}

        def moved(person: Person) -> Person:
            walk = known.get(id(person.walk))
            if walk is None:
                walk = known[id(person.walk)] = person.walk.predicted(dt_s, shift_px, passed)
            return replace(person, walk=walk)

        self._hypotheses = [replace(h, people=tuple(map(moved, h.people))) for h in self._hypotheses]

    def look(self, bodies: Sequence[Body], t_s: float, shown: Callable[[Walk], bool]) -> Told:
        """Take in everybody who is seen in a frame.

        Args:
            bodies: they, in the part of the picture that was looked at.
            t_s: the frame's time.
            shown: whether somebody there is in that part.
        """
        share = min(1.0, (t_s - self._look_s) / _LOOKS_S) if t_s > self._look_s else 1.0
        self._look_s = t_s
        likenesses = _Likenesses(bodies)
        grown: list[Hypothesis] = []
        for hypothesis in self._hypotheses:
            costs = self._costs(hypothesis, bodies, likenesses, share, shown)
            grown += _branches(hypothesis, costs, bodies, t_s)
        self._hypotheses = _merged(grown)
        best = self.best
        probability = sum(h.weight for h in self._hypotheses if h.box == best.box)
        person = best.people[0]
        alike = 0.0 if best.box is None else likenesses.of(person.looks, best.box)
        if best.box is not None and probability > 0.95:
            self._learn(best, bodies, likenesses, alike)
        return Told(best.box, probability, alike, person, best.people[1:])

    def looks_like_target(self, looks: Histogram) -> bool:
        """Whether somebody's colours speak for their being the target."""
        return self._own.evidence(likeness(looks, self.best.people[0].looks)) > _LIKE_TARGET

    def mistakable(self, told: Told) -> bool:
        """Whether somebody of the target's looks is near it, seen or not, so that only their ways tell them apart."""
        target = told.person
        height = target.walk.height_px
        return any(
            other.times >= _BELIEVED_LOOKS
            and self._look_s - other.seen_s < _STILL_NEAR_S
            and math.hypot(other.walk.x_px - target.walk.x_px, other.walk.y_px - target.walk.y_px) < _NEAR * height
            and self._own.usual(likeness(other.looks, target.looks), _AS_ALIKE)
            for other in told.others
        )

    def remember(self, before: Crowd) -> None:
        """Take over the target's looks, and how they vary, from before it was lost."""
        self._own, self._others = before._own, before._others
        looks = before.best.people[0].looks
        self._hypotheses = [
            replace(h, people=(replace(h.people[0], looks=looks), *h.people[1:])) for h in self._hypotheses
        ]

    def _costs(
        self,
        hypothesis: Hypothesis,
        bodies: Sequence[Body],
        likenesses: _Likenesses,
        share: float,
        shown: Callable[[Walk], bool],
    ) -> Matrix:
        """(people, boxes + 1) negative log likelihoods of each match against a newcomer, and of being hidden."""
        people = hypothesis.people
        costs = np.full((len(people), len(bodies) + 1), np.inf)
        for i, person in enumerate(people):
            seen = _chance(person, people) if shown(person.walk) else 0.02
            costs[i, -1] = -math.log(1.0 - seen)
            model = self._others if i else self._own
            for j, body in enumerate(bodies):
                fits = person.walk.log_likelihood(body.seen)
                if fits < _GATE:
                    continue
                fits += share * model.evidence(likenesses.of(person.looks, j))
                costs[i, j] = -fits - math.log(seen) + _NEWCOMER
        return costs

    def _learn(self, best: Hypothesis, bodies: Sequence[Body], likenesses: _Likenesses, alike: float) -> None:
        """The statistics, and the looks of everybody who stands alone."""
        box = best.box
        if box is None:
            return
        own = best.people[0]
        alone = [_alone(j, bodies) for j in range(len(bodies))]
        if alone[box]:
            self._own.learn(alike, same=True)
            self._others.learn(alike, same=True)
            if self._own.usual(alike):
                looks = adapted(own.looks, bodies[box].looks, _ADAPTED)
                self._hypotheses = [
                    replace(h, people=(replace(h.people[0], looks=looks), *h.people[1:]))
                    if h.people[0].looks is own.looks
                    else h
                    for h in self._hypotheses
                ]
        for j in range(len(bodies)):
            if j != box and alone[j]:
                other = likenesses.of(own.looks, j)
                self._own.learn(other, same=False)
                self._others.learn(other, same=False)


class _Likenesses:
    """Of the boxes of a look to people's looks, each computed once."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._bodies = bodies
        self._known: dict[tuple[int, int], tuple[Histogram, float]] = {}

    def of(self, looks: Histogram, j: int) -> float:
        key = id(looks), j
        if key not in self._known:
            self._known[key] = looks, likeness(self._bodies[j].looks, looks)  # kept, so that the id stays taken
        return self._known[key][1]


def _branches(hypothesis: Hypothesis, costs: Matrix, bodies: Sequence[Body], t_s: float) -> list[Hypothesis]:
    """The hypothesis with each box that the target may be, and with the target hidden."""
    options: list[int | None] = [None, *(int(j) for j in np.flatnonzero(np.isfinite(costs[0, :-1])))]
    answer = []
    for option in options:
        taken = np.ones(len(bodies), bool)
        if option is not None:
            taken[option] = False
        columns = np.flatnonzero(taken)
        total = float(costs[0, -1 if option is None else option])
        rest = costs[1:]
        assigned: dict[int, int] = {} if option is None else {0: option}
        if len(rest) and len(columns):
            hidden = np.full((len(rest), len(rest)), np.inf)
            np.fill_diagonal(hidden, rest[:, -1])
            table = np.nan_to_num(np.hstack([rest[:, columns], hidden]), posinf=1e6)
            rows, chosen = linear_sum_assignment(table)
            total += float(table[rows, chosen].sum())
            assigned |= {int(r) + 1: int(columns[c]) for r, c in zip(rows, chosen, strict=True) if c < len(columns)}
        else:
            total += float(rest[:, -1].sum())
        answer.append(_grown(hypothesis, option, assigned, total, bodies, t_s))
    return answer


def _grown(
    hypothesis: Hypothesis,
    option: int | None,
    assigned: dict[int, int],
    cost: float,
    bodies: Sequence[Body],
    t_s: float,
) -> Hypothesis:
    people = []
    for i, person in enumerate(hypothesis.people):
        j = assigned.get(i)
        if j is not None:
            looks = person.looks
            if i and _alone(j, bodies):
                looks = adapted(looks, bodies[j].looks, _ADAPTED)
            people.append(Person(person.walk.updated(bodies[j].seen), looks, t_s, person.times + 1))
        elif i == 0 or t_s - person.seen_s < _KEPT_S[person.times >= _BELIEVED_LOOKS]:
            people.append(replace(person, missed=True))
    known = set(assigned.values())
    people += [_newcomer(body, t_s) for j, body in enumerate(bodies) if j not in known]
    return Hypothesis(hypothesis.weight * math.exp(-min(cost, 600.0)), tuple(people), option)


def _merged(grown: list[Hypothesis]) -> list[Hypothesis]:
    """Normalised, best first; of those that agree about the target the heaviest stands for all."""
    total = sum(h.weight for h in grown)
    if total <= 0.0:
        return [replace(max(grown, key=lambda h: h.weight), weight=1.0)]
    kept: list[Hypothesis] = []
    for h in sorted(grown, key=lambda h: -h.weight):
        weight = h.weight / total
        for k, other in enumerate(kept):
            if other.box == h.box and _same(other.people[0].walk, h.people[0].walk):
                kept[k] = replace(other, weight=other.weight + weight)
                break
        else:
            if len(kept) < KEPT and weight > _LEAST_WEIGHT * 1e-2:
                kept.append(replace(h, weight=weight))
    total = sum(h.weight for h in kept)
    return sorted((replace(h, weight=h.weight / total) for h in kept), key=lambda h: -h.weight)


def _same(one: Walk, other: Walk) -> bool:
    height = one.height_px
    apart = math.hypot(one.x_px - other.x_px, one.y_px - other.y_px) / height
    faster = math.hypot(one.u_px_s - other.u_px_s, one.v_px_s - other.v_px_s) / height
    return apart < 0.1 and faster < 0.3


def _chance(person: Person, people: Sequence[Person]) -> float:
    """Of being seen."""
    if person.times < 2:
        return 0.4
    walk = person.walk
    foot = walk.y_px + 0.5 * walk.height_px
    for other in people:
        if other is person or other.times < 2:
            continue
        nearer = other.walk.y_px + 0.5 * other.walk.height_px > foot
        aside = abs(other.walk.x_px - walk.x_px) / walk.height_px
        above = abs(other.walk.y_px - walk.y_px) / walk.height_px
        if nearer and aside < _COVERING and above < 0.8:
            return _COVERED
    return _SEEN[person.missed]


def _alone(j: int, bodies: Sequence[Body]) -> bool:
    """Whether nobody else is so near that they share colours."""
    here, height = bodies[j].seen, bodies[j].tall_px
    if bodies[j].seen.log_height is None:
        return False
    return all(
        k == j or abs(b.seen.x_px - here.x_px) > _ALONE * height or abs(b.seen.y_px - here.y_px) > 1.1 * height
        for k, b in enumerate(bodies)
    )


def _newcomer(body: Body, t_s: float) -> Person:
    x_px, y_px, log_height = body.seen.x_px, body.seen.y_px, body.seen.log_height
    if log_height is not None:
        return Person(Walk(x_px, y_px, log_height), body.looks, t_s)
    walk = Walk(x_px, y_px, math.log(body.tall_px), place_var=_GUESSED[0] ** 2, size_var=_GUESSED[1] ** 2)
    return Person(walk, body.looks, t_s)
