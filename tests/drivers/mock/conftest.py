"""A mock world on a simulated clock."""

from __future__ import annotations

import pytest

from drivers.mock.bench import MockBench
from drivers.mock.clock import SimulatedClock
from drivers.mock.world import MockWorld
from tacauchy_rig.config.load import load_config


@pytest.fixture
def bench():
    """Return connected mocks on a world of their own."""
    return MockBench.on(MockWorld(SimulatedClock(), load_config().config))
