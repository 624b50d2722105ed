from __future__ import annotations

import pytest

from sitl.autopilot.config import AutopilotConfig, FlavourName
from tests.support.autopilot_bench import Bench


@pytest.fixture(params=["px4", "ardupilot"])
def flavour(request: pytest.FixtureRequest) -> FlavourName:
    name: FlavourName = request.param
    return name


@pytest.fixture
def bench(flavour: FlavourName) -> Bench:
    return Bench(AutopilotConfig(flavour=flavour))


@pytest.fixture
def px4() -> Bench:
    return Bench(AutopilotConfig(flavour="px4"))


@pytest.fixture
def ardupilot() -> Bench:
    return Bench(AutopilotConfig(flavour="ardupilot"))
