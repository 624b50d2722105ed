"""The fleet of this folder: one take-off for all its tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.flown_aircraft import Fleet, fleet_in_the_air


@pytest.fixture(scope="package")
def fleet() -> Iterator[Fleet]:
    with fleet_in_the_air() as found:
        yield found
