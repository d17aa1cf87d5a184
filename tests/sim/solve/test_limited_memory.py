"""What the last steps show of a Hessian."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sim.solve.limited_memory import LimitedMemory


@given(seed=st.integers(0, 10_000), pairs=st.integers(1, 6))
def test_the_last_step_is_foretold(seed: int, pairs: int) -> None:
    """Minus the inverse times the last change is minus the last step, whatever the inverse."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(8, 8))
    hessian = root @ root.T + np.eye(8)
    scales = random.uniform(0.1, 10.0, size=8)
    memory = LimitedMemory(4)
    for _ in range(pairs):
        step = random.normal(size=8)
        memory.learn(step, hessian @ step)
    found = memory.direction(hessian @ step, lambda right: scales * right)
    np.testing.assert_allclose(found, -step, rtol=1e-7, atol=1e-9)


def test_without_memory_it_is_the_inverse_alone() -> None:
    """Nothing learnt, all forgotten, or a step along no curvature: the inverse decides."""
    gradient = np.array([1.0, -2.0, 4.0])
    memory = LimitedMemory(3)
    memory.learn(np.array([1.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.0]))
    memory.forget()
    memory.learn(np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    np.testing.assert_array_equal(memory.direction(gradient, lambda r: 0.5 * r), -0.5 * gradient)
    np.testing.assert_array_equal(gradient, [1.0, -2.0, 4.0])
