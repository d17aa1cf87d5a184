"""What the last steps show of a Hessian, in the kernels' two loops."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.device import Device
from sim.solve.lbfgs_kernels import (
    Memory,
    add_all,
    first_loop,
    note_products,
    products_with,
    second_loop,
)
from tacauchy_rig.core.arrays import FloatArray

_ROWS, _LENGTH = 8, 4


@wp.kernel(enable_backward=False, module="unique")
def _learn(memory: Memory, gradient: wp.array2d(dtype=wp.float64), own: wp.float64):
    b = wp.tid()
    memory.next[b] = (memory.next[b] + 1) % memory.table.shape[1]
    memory.counts[b] = wp.min(memory.counts[b] + 1, memory.table.shape[1])
    products_with(memory.steps, gradient, memory.counts[b], b, memory.products)
    note_products(memory, b, wp.float64(1.0), own)


@wp.kernel(enable_backward=False, module="unique")
def _ask(memory: Memory, gradient: wp.array2d(dtype=wp.float64), out: wp.array2d(dtype=wp.float64)):
    b = wp.tid()
    products_with(memory.steps, gradient, memory.counts[b], b, memory.products)
    first_loop(memory, b)
    down = wp.float64(-1.0)
    add_all(memory.changes, memory.shares, memory.counts[b], b, down, gradient, out)


@wp.kernel(enable_backward=False, module="unique")
def _answer(memory: Memory, out: wp.array2d(dtype=wp.float64)):
    b = wp.tid()
    products_with(memory.changes, out, memory.counts[b], b, memory.products)
    second_loop(memory, b)
    add_all(memory.steps, memory.shares, memory.counts[b], b, wp.float64(1.0), out, out)


def _two_loops(
    pairs: list[tuple[FloatArray, FloatArray]], gradient: FloatArray, scales: FloatArray
) -> FloatArray:
    """Return what Nocedal and Wright's algorithm 7.4 gives, as it is written."""
    left, shares = -gradient, []
    for step, change in reversed(pairs):
        shares.append(step @ left / (step @ change))
        left = left - shares[-1] * change
    found = scales * left
    for step, change in pairs:
        found = found + (shares.pop() - change @ found / (step @ change)) * step
    return found


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 7))
def test_steps_along_its_own_directions_give_the_two_loops(seed: int, count: int) -> None:
    """Also where the ring has come round; the last change is then answered by the last step."""
    random, device = np.random.default_rng(seed), Device("cpu")
    root = random.normal(size=(_ROWS, _ROWS))
    hessian = root @ root.T + np.eye(_ROWS)
    scales = random.uniform(0.1, 10.0, size=_ROWS)
    memory = _memory(device)
    pairs: list[tuple[FloatArray, FloatArray]] = []
    gradient = device.array(random.normal(size=(1, _ROWS)), wp.float64)
    out = device.zeros((1, _ROWS), wp.float64)
    for _ in range(count):
        wp.launch(_ask, 1, [memory, gradient, out], device="cpu")
        out.numpy()[0] *= scales
        wp.launch(_answer, 1, [memory, out], device="cpu")
        direction = out.numpy()[0].copy()
        expected = _two_loops(pairs[-_LENGTH:], gradient.numpy()[0], scales)
        np.testing.assert_allclose(
            direction, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max()
        )
        change = hessian @ direction
        at = int(memory.next.numpy()[0])
        memory.steps.numpy()[0, at], memory.changes.numpy()[0, at] = direction, change
        gradient.numpy()[0] += change
        wp.launch(_learn, 1, [memory, gradient, wp.float64(direction @ change)], device="cpu")
        pairs.append((direction, change))
    kept = [pairs[-1 - k] for k in range(min(count, _LENGTH))]
    table = memory.table.numpy()[0]
    order = [(int(memory.next.numpy()[0]) - 1 - k) % _LENGTH for k in range(len(kept))]
    for i, (step, _) in zip(order, kept, strict=True):
        for j, (_, change) in zip(order, kept, strict=True):
            assert table[i, j] == pytest.approx(float(step @ change), rel=1e-4, abs=1e-4)


def _memory(device: Device) -> Any:
    return device.zeroed(
        Memory,
        (1, _LENGTH),
        steps=(1, _LENGTH, _ROWS),
        changes=(1, _LENGTH, _ROWS),
        table=(1, _LENGTH, _LENGTH),
        counts=(1,),
        next=(1,),
    )
