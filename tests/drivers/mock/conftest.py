"""A mock world on a simulated clock."""

from __future__ import annotations

import pytest

from drivers.mock.world import MockWorld
from tacauchy_rig.core.config.load import load_config
from tests.mock_bench import MockBench, SimulatedClock


@pytest.fixture
def bench():
    """Return connected mocks on a world of their own."""
    return MockBench.on(MockWorld(SimulatedClock(), load_config().config))
