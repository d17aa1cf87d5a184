"""Springs of friction: they hold up to their limit, and remember."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.emulators.plant.grip import STICK_PER_M, Springs

DOWN = np.tile([0.0, -1.0], (3, 1))
LIMIT = np.array([0.1, 0.2, 0.0])


def _at(radius: float) -> np.ndarray:
    return np.column_stack([np.full(3, radius), np.zeros(3)])


def test_what_is_drawn_beyond_its_limit_slips() -> None:
    """A spring pulls as far as it is drawn, and no further than friction times pressure."""
    springs = Springs(None, _at(0.0), DOWN, LIMIT)
    drawn = 0.15 / STICK_PER_M
    pull, _ = springs.linearised(_at(drawn))
    assert np.abs(pull[:, 0]) == pytest.approx([0.1, 0.15, 0.0])
    assert list(springs.sticks(_at(drawn))) == [0.0, 1.0, 0.0]


def test_pull_and_stiffness_are_derivatives_of_the_energy() -> None:
    """Newton's method has a line search: central differences agree on both sides of slipping."""
    springs = Springs(None, _at(0.0), DOWN, LIMIT)
    step = 1e-12
    for place in (0.05 / STICK_PER_M, 0.5 / STICK_PER_M):
        slope = (springs.energy(_at(place + step)) - springs.energy(_at(place - step))) / (2 * step)
        assert slope == pytest.approx(springs.linearised(_at(place))[0][:, 0], abs=1e-5)


def test_a_grip_is_remembered() -> None:
    """Going back from a slip releases the spring, then draws it the other way."""
    first = Springs(None, _at(0.0), DOWN, LIMIT)
    slipped = first.drawn(_at(1.0 / STICK_PER_M), LIMIT)
    back = Springs(slipped, _at(1.0 / STICK_PER_M), DOWN, LIMIT)
    pull, _ = back.linearised(_at(0.9 / STICK_PER_M))
    assert pull[:, 0] == pytest.approx([0.0, 0.1, 0.0], abs=1e-9)
