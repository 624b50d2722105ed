"""The steadied rotation over whole patterns, and what is said of many flights."""

from __future__ import annotations

import pytest

from sitl.evaluation.bundle import Rotation, main, measured, summary
from sitl.evaluation.rendered import Case


def test_a_flight_past_a_street_is_steadied() -> None:
    found = measured(Case(3, 2.75, None, noise="rough", size_px=(320, 240), renderings=1))
    assert found.heading_deg is not None
    assert found.heading_deg < 0.5 * found.reported_heading_deg
    assert "steadied by the background" in found.said


def test_flights_that_fell_back_are_counted_apart() -> None:
    found = [Rotation(2.0, 0.3, 0.1, ""), Rotation(2.0, 0.4, 0.1, ""), Rotation(1.0, None, None, "too dark")]
    assert summary(found) == "steadied 2 of 3: heading 0.354 deg rms (median 0.350, worst 0.400), tilt 0.100 deg rms"
    assert summary(found[2:]) == "steadied 0 of 1"


def test_a_scene_that_is_not_there_is_refused() -> None:
    with pytest.raises(SystemExit):
        main(["--scene", "moon"])
