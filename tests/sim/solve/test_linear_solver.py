"""The solver in single precision."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sim.mesh.discretisation import SparsePattern, sparse_pattern
from sim.solve.linear_solver import (
    LinearSolver,
    NotPositiveDefiniteError,
    SuperLuSolver,
    linear_solver,
)


@pytest.fixture
def pattern() -> SparsePattern:
    """Return a chain of bars, held at one end."""
    elements = np.array([[k, k + 1] for k in range(20)], dtype=np.int32)
    fixed = np.zeros((21, 3), dtype=np.bool_)
    fixed[0] = True
    return sparse_pattern(elements, fixed)


def in_double(pattern: SparsePattern) -> LinearSolver:
    """Return what computes in float64."""
    return linear_solver(pattern, np.float64)


def matrix(pattern: SparsePattern, diagonal: float) -> tuple[np.ndarray, np.ndarray]:
    """Return CSR values with a diagonal, and the whole matrix."""
    data = np.full(len(pattern.indices), 0.25)
    data[pattern.indptr[:-1]] = diagonal
    dense = np.zeros((pattern.dof_count, pattern.dof_count))
    rows = np.repeat(np.arange(pattern.dof_count), np.diff(pattern.indptr))
    dense[rows, pattern.indices] = data
    return data, np.triu(dense) + np.triu(dense, 1).T


def test_it_solves_to_single_precision(pattern: SparsePattern) -> None:
    """Refactored with other values, it solves with those."""
    solver = linear_solver(pattern)
    right = np.linspace(-1.0, 1.0, pattern.dof_count)
    for diagonal in (4.0, 9.0):
        data, dense = matrix(pattern, diagonal)
        solver.factorise(data)
        found = solver.solve(right)
        np.testing.assert_allclose(found, np.linalg.solve(dense, right), rtol=1e-4, atol=1e-6)


def test_an_indefinite_matrix_is_refused(pattern: SparsePattern) -> None:
    """A negative pivot is told apart from other errors, and the solver goes on after it."""
    solver = linear_solver(pattern)
    with pytest.raises(NotPositiveDefiniteError):
        solver.factorise(matrix(pattern, -4.0)[0])
    data, dense = matrix(pattern, 4.0)
    solver.factorise(data)
    found = solver.solve(np.ones(pattern.dof_count))
    np.testing.assert_allclose(dense @ found, 1.0, atol=1e-5)


@pytest.mark.parametrize("make", [linear_solver, in_double, SuperLuSolver])
def test_many_at_once_are_each_alone(
    pattern: SparsePattern, make: Callable[[SparsePattern], LinearSolver]
) -> None:
    """And the matrix undoes them."""
    solver, (data, dense) = make(pattern), matrix(pattern, 4.0)
    solver.factorise(data)
    right = np.random.default_rng(1).standard_normal((5, pattern.dof_count))
    found = solver.solve(right)
    np.testing.assert_allclose(found @ dense, right, atol=1e-5)
    np.testing.assert_allclose(found, [solver.solve(each) for each in right], atol=1e-6)
