"""What a likeness of colours says, learnt from look to look."""

from __future__ import annotations

import numpy as np

from mission.track.likeness import LikenessModel


def test_more_alike_never_speaks_more_against_the_target() -> None:
    model = LikenessModel()
    evidence = [model.evidence(float(v)) for v in np.linspace(0.0, 1.0, 50)]
    assert np.all(np.diff(evidence) >= 0.0)
    assert evidence[0] < -3.0
    assert evidence[-1] > 1.0


def test_where_others_are_as_alike_as_the_target_itself_colours_tell_nothing() -> None:
    model = LikenessModel()
    for _ in range(60):
        model.learn(0.9, same=False)
        model.learn(0.85, same=True)
    assert [model.evidence(v) for v in (0.2, 0.85, 0.95)] == [0.0, 0.0, 0.0]


def test_a_target_that_varies_much_is_not_given_up_for_looking_otherwise() -> None:
    steady, varied = LikenessModel(), LikenessModel()
    rng = np.random.default_rng(1)
    for value in rng.normal(0.6, 0.2, 80).clip(0.0, 1.0):
        steady.learn(0.85, same=True)
        varied.learn(float(value), same=True)
    assert varied.evidence(0.4) > steady.evidence(0.4) + 2.0
    assert varied.usual(0.4)
    assert not steady.usual(0.4)
