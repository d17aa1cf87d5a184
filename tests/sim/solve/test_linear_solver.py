"""The solver in single precision, and how many threads MKL takes unless a user chose."""

import os
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sim.mesh.clamping_and_sparsity import SparsePattern, sparse_pattern
from sim.solve import linear_solver as solvers
from sim.solve.linear_solver import (
    LinearSolver,
    NotPositiveDefiniteError,
    SuperLuSolver,
    linear_solver,
)


def chain(count: int) -> SparsePattern:
    """Return the pattern of so many bars in a row, held at one end."""
    elements = np.array([[k, k + 1] for k in range(count)], dtype=np.int32)
    fixed = np.zeros((count + 1, 3), dtype=np.bool_)
    fixed[0] = True
    return sparse_pattern(elements, fixed)


@pytest.fixture
def pattern() -> SparsePattern:
    """Return a chain of twenty bars."""
    return chain(20)


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


@pytest.mark.parametrize("make", [linear_solver, SuperLuSolver])
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


VARIABLES = ("MKL_NUM_THREADS", "OMP_NUM_THREADS")
CORES = len(os.sched_getaffinity(0))


@pytest.fixture
def nothing_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A user who has set no variable."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def library() -> Any:
    """MKL, which is asked what it would do."""
    pytest.importorskip("pypardiso")
    return solvers.pardiso_module().PyPardisoSolver(mtype=2).libmkl


def factored(solver: LinearSolver, count: int) -> None:
    """Factor a chain's matrix and hold its solution against what it has to be."""
    data, dense = matrix(chain(count), 4.0)
    solver.factorise(data)
    np.testing.assert_allclose(dense @ solver.solve(np.ones(3 * count)), 1.0, rtol=1e-5)


@pytest.mark.usefixtures("nothing_chosen")
def test_mkl_takes_one_thread_for_a_small_system(library: Any) -> None:
    """MKL itself says so, also after a large system that took more."""
    solvers.take_threads(library, 1_000_000)
    assert library.MKL_Get_Max_Threads() == min(4, CORES)
    factored(linear_solver(chain(20)), 20)
    assert library.MKL_Get_Max_Threads() == 1


@pytest.mark.parametrize("name", VARIABLES)
@pytest.mark.usefixtures("nothing_chosen")
def test_a_user_overrules_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A number in either variable holds for every size; what is no number is no choice."""
    monkeypatch.setenv(name, "3")
    assert [solvers.thread_count(unknowns) for unknowns in (10, 1_000_000)] == [3, 3]
    monkeypatch.setenv(name, "many")
    assert solvers.thread_count(10) == 1


@pytest.mark.usefixtures("nothing_chosen")
def test_solvers_of_two_sizes_live_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """One with several threads and one with one take turns; a mixture of both would crash."""
    monkeypatch.setattr(solvers, "_SEVERAL_FROM_UNKNOWNS", 100)
    small, large = (linear_solver(chain(count)) for count in (20, 60))
    for _ in range(2):
        factored(large, 60)
        factored(small, 20)


def test_the_library_is_found_without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where MKL is installed as a package, its place is known before pypardiso is imported."""
    pytest.importorskip("pypardiso")
    monkeypatch.delenv("PYPARDISO_MKL_RT", raising=False)
    solvers.pardiso_module()
    assert "libmkl_rt" in os.environ["PYPARDISO_MKL_RT"]
