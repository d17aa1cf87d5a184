"""The offset of two clocks is found, and as well as it says."""

from __future__ import annotations

import numpy as np
import pytest

from tacauchy_rig.app.importing.offset import MEMORY_S, MEMORY_SHARE, Signal, without_memory
from tests.tacauchy_rig.app.importing.offsets import SLOW_M_S, offset_of, recorded


@pytest.mark.parametrize("with_height", [True, False])
def test_a_gel_that_remembers_is_within_what_is_stated(with_height: bool) -> None:
    """Let go as slowly as it was pressed, its force falls before its shape does."""
    world = recorded(1, release_m_s=SLOW_M_S)
    offset = offset_of(world, with_height=with_height)
    assert offset.seconds == pytest.approx(world.true_s, abs=2.0 * offset.uncertainty_s)
    assert 0.005 < offset.uncertainty_s < 0.03


def test_what_a_gel_remembers_is_taken_off() -> None:
    """A force that fades as the gel does is left as it ends."""
    time_s = np.arange(0.0, 3.0, 0.001)
    pressed = time_s >= 1.0
    fades = MEMORY_SHARE * np.exp(-(time_s - 1.0) / MEMORY_S)
    left = without_memory(Signal(time_s=time_s, value=np.where(pressed, 1.0 + fades, 0.0)))
    assert left.at(np.array([0.5, 1.01, 1.2, 2.5])) == pytest.approx([0, 1, 1, 1], abs=1e-3)
