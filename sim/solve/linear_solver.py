"""Direct solvers for the symmetric Newton matrix, and the factored stiffness of one state.

docs/explanation/solver.md describes the matrix; the safest has a share of the undeformed pad's
stiffness added. Under a given force F the height z of the indenter is one more unknown, and F z is
added to the energy: its row and column border the matrix, so that one factorisation and one more
solution serve both.
"""

import ctypes
import importlib
import logging
import os
import weakref
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
import warp as wp
from numpy.typing import NDArray

from sim.contact.barrier_and_friction_kernels import LEAST_ALONG
from sim.contact.surface_and_grip import State
from sim.device import Device, on_host
from sim.mesh.clamping_and_sparsity import SparsePattern
from sim.scene.indenter import Indenter
from sim.solve.model import Model
from sim.solve.weight_and_inertia import Potential
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError

# Read by MKL too, in this order: who sets one has chosen for every system.
_CHOSEN_BY_USER = ("MKL_NUM_THREADS", "OMP_NUM_THREADS")
# Several threads cost a factor processor time while they wait for one another: a quarter to a half
# more below this many unknowns, a fifth above. More than four were not tried. Measured by
# docs/decisions/0009-one-thread-for-small-systems.md.
_SEVERAL_FROM_UNKNOWNS, _THREADS_MAX = 50_000, 4
# Where pypardiso looks for the library first.
_LIBRARY = "PYPARDISO_MKL_RT"


def pardiso_module() -> Any:
    """Return pypardiso with MKL's place set: it would search every folder of the installation.

    Raises:
        ImportError: It, or MKL, is not installed.
    """
    if _LIBRARY not in os.environ and (library := _installed_library()):
        os.environ[_LIBRARY] = library
    return importlib.import_module("pypardiso")


def thread_count(unknowns: int) -> int:
    """Return how many threads a system of so many unknowns is factored with."""
    for name in _CHOSEN_BY_USER:
        text = os.environ.get(name, "")
        if text.isdigit() and int(text) > 0:
            return int(text)
    if unknowns < _SEVERAL_FROM_UNKNOWNS:
        return 1
    return min(_THREADS_MAX, len(os.sched_getaffinity(0)))


def take_threads(library: Any, unknowns: int) -> None:
    """Let MKL take as many threads as a system of so many unknowns deserves.

    To be called before every phase: Pardiso crashes where a factor meets another number of threads
    than its analysis had, and the number is that of the process.
    """
    library.MKL_Set_Num_Threads(thread_count(unknowns))


def _installed_library() -> str:
    """Return MKL's own library as its distribution lists it, or nothing."""
    try:
        files = metadata.files("mkl") or []
    except metadata.PackageNotFoundError:
        return ""
    found = (file.locate() for file in files if file.name.startswith("libmkl_rt"))
    return next((str(Path(str(each)).resolve()) for each in found), "")


# Pardiso's phases, and its error for a negative or zero pivot.
_ANALYSE, _FACTORISE, _SOLVE, _RELEASE = 11, 22, 33, -1
_NOT_POSITIVE_DEFINITE = -4
# Pardiso's iparm by place, from 1: no defaults, no steps of refinement, no scaling, rows from 0.
# Second is the order of elimination: minimum degree takes a tenth fewer operations than nested
# dissection at a few thousand unknowns, and a fifth more at ten thousand. Single precision (28) is
# enough for a preconditioner.
_SETTINGS = {1: 1, 2: 0, 8: 0, 10: 0, 11: 0, 13: 0, 28: 1, 35: 1}
_DISSECTED_FROM, _DISSECTION = 6_000, 2


class NotPositiveDefiniteError(ArithmeticError):
    """The matrix has a negative or zero pivot: the caller projects or shifts it."""


class SuperLuSolver:
    """Fallback for machines without MKL: SciPy's SuperLU in symmetric mode, in float64."""

    name = "superlu"

    def __init__(self, pattern: SparsePattern) -> None:
        self._upper = pattern.upper(np.ones(len(pattern.indices)))
        self._factor: Any = None

    def factorise(self, data: FloatArray) -> None:
        """Factor the matrix, as ``PardisoSolver`` does."""
        self._upper.data[:] = data
        full = self._upper + scipy.sparse.triu(self._upper, 1).T
        symmetric = {"SymmetricMode": True}
        try:
            self._factor = scipy.sparse.linalg.splu(
                full.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric
            )
        except RuntimeError as error:
            raise NotPositiveDefiniteError(str(error)) from error
        if np.any(self._factor.U.diagonal() <= 0.0):
            raise NotPositiveDefiniteError("negative pivot")

    def solve(self, right_side: FloatArray) -> FloatArray:
        """Solve with the last factor, as ``PardisoSolver`` does."""
        return np.asarray(self._factor.solve(right_side.T).T)


class PardisoSolver:
    """Cholesky by Intel MKL Pardiso (matrix type 2), in single precision."""

    name = "pardiso, float32"

    def __init__(self, pattern: SparsePattern, pypardiso: Any) -> None:
        # pypardiso knows where MKL is, but passes double precision only, and one vector at a time.
        self._library = ctypes.CDLL(pypardiso.PyPardisoSolver(mtype=2).libmkl._name)  # noqa: SLF001
        self._count = pattern.dof_count
        settings = np.zeros(64, dtype=np.int32)
        for place, value in _SETTINGS.items():
            settings[place - 1] = value
        if self._count >= _DISSECTED_FROM:
            settings[1] = _DISSECTION
        self._values = np.ones(len(pattern.indices), dtype=np.float32)
        self._error = ctypes.c_int32(0)
        arrays = [np.zeros(64, dtype=np.int64), self._values]
        arrays += [np.asarray(index, np.int32) for index in (pattern.indptr, pattern.indices)]
        arrays += [np.zeros(self._count, dtype=np.int32), settings]
        self._call = _pardiso(self._library, arrays, count=self._count, error=self._error)
        self._run(_ANALYSE)
        weakref.finalize(self, self._call, _RELEASE)

    def factorise(self, data: FloatArray) -> None:
        """Factor the matrix with the CSR values ``data`` of the upper triangle.

        Raises:
            NotPositiveDefiniteError: The matrix is not positive definite.
        """
        self._values[:] = data
        self._run(_FACTORISE)

    def solve(self, right_side: FloatArray) -> FloatArray:
        """Solve with the last factor, shape [dof_count], or many at once [count, dof_count]."""
        right = right_side.astype(np.float32, order="C")
        found = np.empty_like(right)
        self._run(_SOLVE, right, found)
        return found.astype(np.float64)

    def _run(self, phase: int, *vectors: NDArray[Any]) -> None:
        take_threads(self._library, self._count)
        self._call(phase, *vectors)
        if self._error.value == _NOT_POSITIVE_DEFINITE:
            raise NotPositiveDefiniteError("negative pivot")
        if self._error.value != 0:
            raise ConvergenceError(
                f"Pardiso ended phase {phase} with error {self._error.value}",
                remedy="free memory, or use another preset",
            )


LinearSolver = PardisoSolver | SuperLuSolver


def linear_solver(pattern: SparsePattern) -> LinearSolver:
    """Return Pardiso where it is installed, else SuperLU; both take the same pattern."""
    try:
        return PardisoSolver(pattern, pardiso_module())
    except ImportError:
        return SuperLuSolver(pattern)


def _pardiso(
    library: Any, arrays: list[Any], *, count: int, error: ctypes.c_int32
) -> Callable[..., None]:
    """Return Pardiso by its phase, its long argument list made once; it keeps the arrays alive."""
    handle, values, starts, columns, order, settings = (_address(array) for array in arrays)
    one, kind, silent, size = (ctypes.byref(ctypes.c_int32(value)) for value in (1, 2, 0, count))
    number, vector_count = ctypes.c_int32(0), ctypes.c_int32(1)
    usual = [handle, one, one, kind, ctypes.byref(number), size, values, starts, columns, order]
    usual += [ctypes.byref(vector_count), settings, silent]

    def call(phase: int, *vectors: NDArray[Any]) -> None:
        number.value = phase
        vector_count.value = max(1, sum(each.size for each in vectors[:1]) // count)
        right, found = map(_address, vectors) if vectors else (None, None)
        library.pardiso(*usual, right, found, ctypes.byref(error))

    return call


def _address(array: NDArray[Any]) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


logger = logging.getLogger(__name__)
# Shares of the undeformed pad's stiffness that are added until the matrix is positive definite.
_SHIFTS = (0.0, 1e-3, 1e-1, 1.0)
# Least stiffness that holds a pushed indenter, over E H with the pad's height H: where nothing
# touches it goes down by the longest step.
_HELD = 1e-6


class StiffnessFactor:
    """Factors the stiffness of one pad under one indenter.

    Attributes:
        name: What factors it.
        attempt: Of the last: 0 the Hessian, above ever safer.
        held: The indenter is; else its height is the last unknown.
    """

    kind, scaled, unit, column_count = wp.float64, False, 1.0, 1

    def __init__(
        self, model: Model, indenter: Indenter, potential: Potential | None = None
    ) -> None:
        self._model, self._indenter, self.potential = model, indenter, potential
        self._solver = linear_solver(model.pattern)
        self.name = self._solver.name
        # Of a pushed indenter's height: its column [N/m], and what the nodes answer it with.
        self._border: tuple[FloatArray, FloatArray] | None = None
        self._contact_n_m, self._corner = np.zeros(0), 0.0
        self._least = _HELD * model.young_pa * model.height_m
        self.made, self.attempt, self.held = 0, 0, True
        self.row_count = model.pattern.dof_count + 1
        self.weights = Device(model.device).array(np.ones(self.row_count), wp.float32)

    def renew(self, state: State, *, first: int = 0) -> None:
        """Take a state's stiffness, or the first safer one that is positive definite.

        Raises:
            ConvergenceError: No safe matrix was found.
        """
        model = self._model
        least = LEAST_ALONG if model.contact_options.is_wide else 0.0
        contact = model.surface.forces(state.positions, self._indenter, state, least=least)
        for attempt in range(first, 2 + len(_SHIFTS)):
            data = model.hessian_data(state.positions, contact.stiffness, projected=attempt > 0)
            shift = _SHIFTS[max(0, attempt - 2)]
            if shift > 0.0:
                data = data + shift * model.rest_hessian_data()
            if self.potential is not None:
                added = model.pattern.unknowns(self.potential.diagonal())
                data[model.pattern.indptr[:-1]] += added
            self.made += 1
            try:
                self._solver.factorise(data)
            except NotPositiveDefiniteError:
                logger.debug("Hessian not positive definite (attempt %d)", attempt)
                continue
            self.attempt = attempt
            self._border, self._contact_n_m = None, contact.stiffness
            self._corner = float(contact.stiffness[..., 2, 2].sum())
            return
        raise ConvergenceError(
            "the stiffness matrix is not positive definite even when projected and shifted",
            remedy="the mesh has degenerate tetrahedra or lost its clamped base: check it",
        )

    def apply(self, asked: Any, sources: Any, found: Any, prepare: Callable[[], None]) -> None:  # noqa: ARG002
        """Set ``found`` to the inverse times ``sources``, shape [1, row_count]."""
        prepare()
        right = on_host(sources)[0]
        solved = np.append(self._solver.solve(right[:-1]), 0.0)
        if not self.held:
            if self._border is None:
                pushed = self._model.surface.scatter(-self._contact_n_m[..., 2])
                row = self._model.pattern.unknowns(pushed)
                self._border = row, self._solver.solve(row)
            border, along = self._border
            corner = max(self._corner - float(border @ along), self._least)
            solved[-1] = (right[-1] - solved[:-1] @ border) / corner
            solved[:-1] -= solved[-1] * along
        if self._model.device == "cpu":
            found.numpy()[0] = solved
        else:
            found.assign(solved[None])

    def solve(self, right: FloatArray) -> FloatArray:
        """Solve for the unknowns without the indenter's height."""
        return self._solver.solve(right)
