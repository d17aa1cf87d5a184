"""How many threads MKL takes: the program's choice, unless a user made one."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

from sim.mesh.discretisation import sparse_pattern
from sim.solve import linear_solver as solvers
from sim.solve.linear_solver import LinearSolver, linear_solver

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
    solver.factorise(np.where(is_diagonal(count), 4.0, 0.0))
    np.testing.assert_allclose(solver.solve(np.ones(3 * count)), 0.25, rtol=1e-5)


def chain(count: int) -> Any:
    """Return the pattern of so many bars in a row, held at one end."""
    elements = np.array([[k, k + 1] for k in range(count)], dtype=np.int32)
    fixed = np.zeros((count + 1, 3), dtype=np.bool_)
    fixed[0] = True
    return sparse_pattern(elements, fixed)


def is_diagonal(count: int) -> Any:
    """Return which values of the chain's matrix stand on its diagonal."""
    pattern = chain(count)
    on = np.zeros(len(pattern.indices), dtype=np.bool_)
    on[pattern.indptr[:-1]] = True
    return on


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
def test_solvers_of_both_kinds_live_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """One with several threads and one with one take turns; a mixture of both would crash."""
    monkeypatch.setattr(solvers, "_SEVERAL_FROM_UNKNOWNS", 100)
    for kind in (np.float64, np.float32):
        small, large = (linear_solver(chain(count), kind) for count in (20, 60))
        for _ in range(2):
            factored(large, 60)
            factored(small, 20)


def test_the_library_is_found_without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where MKL is installed as a package, its place is known before pypardiso is imported."""
    pytest.importorskip("pypardiso")
    monkeypatch.delenv("PYPARDISO_MKL_RT", raising=False)
    solvers.pardiso_module()
    assert "libmkl_rt" in os.environ["PYPARDISO_MKL_RT"]
