from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.framing import decode, frames
from sitl.faults import FrameMutator, dialect_frames


def _mutator(seed: int) -> FrameMutator:
    rng = np.random.default_rng(seed)
    return FrameMutator(dialect_frames(rng), rng)


def test_there_is_a_valid_frame_of_every_message_addressed_as_asked() -> None:
    found = dialect_frames(np.random.default_rng(1), 255, 190, target=(1, 100))
    decoded = [decode(mavlink.MAVLink(None), frame) for frame in found]
    assert len({m.get_type() for m in decoded if m is not None}) == len(mavlink.mavlink_map)
    addressed = [m for m in decoded if m is not None and hasattr(m, "target_component")]
    assert len(addressed) > 80
    assert {(m.target_system, m.target_component) for m in addressed} == {(1, 100)}


@pytest.mark.parametrize("draw", [FrameMutator.mutated, FrameMutator.noise])
def test_the_same_seed_gives_the_same_damage(draw: Callable[[FrameMutator], bytes]) -> None:
    one, same, other = _mutator(7), _mutator(7), _mutator(8)
    first = [draw(one) for _ in range(200)]
    assert first == [draw(same) for _ in range(200)]
    assert first != [draw(other) for _ in range(200)]


def test_about_half_of_the_mutated_frames_get_past_the_checksum_and_the_rest_do_not() -> None:
    mutator, parser = _mutator(2), mavlink.MAVLink(None)
    valid = sum(any(decode(parser, f) is not None for _, f in frames(mutator.mutated())) for _ in range(2000))
    assert 0.4 < valid / 2000 < 0.85
