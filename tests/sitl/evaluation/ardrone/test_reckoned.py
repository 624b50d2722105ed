"""What the aircraft's own errors cost, drawn without pictures."""

from __future__ import annotations

import math

import numpy as np

from sitl.ardrone.sensors import PRESETS
from sitl.evaluation.ardrone.reckoned import fly_reckoned
from sitl.evaluation.ardrone.rows import ARDRONE_ROWS

STANDING, PARALLEL = ARDRONE_ROWS[1], ARDRONE_ROWS[9]


def test_an_aircraft_without_errors_is_as_good_as_the_truth() -> None:
    flown = fly_reckoned(STANDING, PRESETS["none"], np.random.default_rng(1))
    assert flown.reckoned < 2.5
    assert flown.steadied < 2.5
    assert flown.undrifted < 2.5


def test_the_aircraft_s_errors_cost_more_than_the_tracker_s() -> None:
    flown = fly_reckoned(STANDING, PRESETS["rough"], np.random.default_rng(1))
    assert flown.reckoned > 2.0 * flown.undrifted
    assert flown.steadied > 2.0 * flown.undrifted


def test_the_formula_is_asked_about_the_walk_that_it_is_for() -> None:
    flown = fly_reckoned(PARALLEL, PRESETS["none"], np.random.default_rng(2))
    assert math.isfinite(flown.formula)
    assert flown.formula < 15.0
