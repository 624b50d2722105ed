"""How much is mutated: 100,000 packets and streams with `SIDESTEP_MUTATIONS=100000`, fewer in an ordinary run."""

from __future__ import annotations

import os

import pytest


@pytest.fixture
def mutations() -> int:
    return int(os.environ.get("SIDESTEP_MUTATIONS", "4000"))
