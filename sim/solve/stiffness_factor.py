"""The stiffness of one state, factored: what a step's direction is made with.

The exact Hessian is factored; only when that is not positive definite is it replaced by a
semidefinite one, at last with a share of the undeformed pad's stiffness added.

Under a given force the height z of the indenter is one more unknown, and F z is added to the
energy. Its row and column border the stiffness matrix, so that one factorisation and one more
solution serve both.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.contact.state import State
from sim.device import on_host
from sim.scene.indenter import Indenter
from sim.solve.linear_solver import (
    BorderedSolver,
    LinearSolver,
    NotPositiveDefiniteError,
    linear_solver,
)
from sim.solve.model import Model
from sim.solve.nodal_energies import Potential
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError

logger = logging.getLogger(__name__)
# Shares of the undeformed pad's stiffness that are added until the matrix is positive definite.
_SHIFTS = (0.0, 1e-3, 1e-1, 1.0)
# A stiffness that is none, over E H with the pad's height H.
_HELD = 1e-13


class StiffnessFactor:
    """Factors the stiffness of one pad under one indenter.

    Attributes:
        attempt: Of the last: 0 exact, above ever safer.
        held: The indenter is; else its height is the last unknown.
    """

    kind, scaled, unit, column_count = wp.float64, False, 1.0, 1

    def __init__(
        self, model: Model, indenter: Indenter, potentials: Sequence[Potential] = ()
    ) -> None:
        self._model, self._indenter, self.potentials = model, indenter, potentials
        self._quick: LinearSolver = linear_solver(model.pattern)
        self._exact: LinearSolver | None = None
        self._solver = self._quick
        self._bordered: BorderedSolver | None = None
        self._contact_n_m, self._corner = np.zeros(0), 0.0
        self._least = _HELD * model.young_pa * model.height_m
        self.made, self.attempt, self.held = 0, 0, True
        self.row_count = model.pattern.dof_count + 1

    @property
    def name(self) -> str:
        """What factors it."""
        return self._solver.name

    def renew(self, state: State, *, first: int = 0) -> None:
        """Take a state's stiffness, or the first safer one that is positive definite.

        Raises:
            ConvergenceError: No safe matrix was found.
        """
        model = self._model
        for attempt in range(first, 2 + len(_SHIFTS)):
            contact = model.surface.forces(
                state.positions, self._indenter, state, curved=attempt == 0
            )
            data = model.hessian_data(state.positions, contact.stiffness, projected=attempt > 0)
            shift = _SHIFTS[max(0, attempt - 2)]
            if shift > 0.0:
                data = data + shift * model.rest_hessian_data()
            for potential in self.potentials:
                data[model.pattern.indptr[:-1]] += model.pattern.unknowns(potential.diagonal())
            self._solver = self._quick if attempt < 2 else self._in_double_precision()
            self.made += 1
            try:
                self._solver.factorise(data)
            except NotPositiveDefiniteError:
                logger.debug("Hessian not positive definite (attempt %d)", attempt)
                continue
            self.attempt = attempt
            self._bordered, self._contact_n_m = None, contact.stiffness
            self._corner = float(contact.stiffness[..., 2, 2].sum())
            return
        raise ConvergenceError(
            "the stiffness matrix is not positive definite even when projected and shifted",
            remedy="the mesh has degenerate tetrahedra or lost its clamped base: check it",
        )

    @property
    def touches(self) -> bool:
        """The gel holds the indenter; without, a load has no direction to go by."""
        return self._corner > self._least

    def apply(self, asked: NDArray[np.int32] | None, sources: Any, found: Any) -> None:  # noqa: ARG002
        """Set ``found`` to the inverse times ``sources``, shape [1, row_count]."""
        whole = BorderedSolver(self._solver) if self.held else self._pushed()
        solved = whole.solve(on_host(sources)[0])
        if self._model.device == "cpu":
            found.numpy()[0] = solved
        else:
            found.assign(solved[None])

    def solve(self, right: FloatArray) -> FloatArray:
        """Solve for the unknowns without the indenter's height."""
        return self._solver.solve(right)

    def _pushed(self) -> BorderedSolver:
        if self._bordered is None:
            pushed = self._model.surface.scatter(-self._contact_n_m[..., 2])
            border = self._model.pattern.unknowns(pushed)
            self._bordered = BorderedSolver(self._solver, border, self._corner, least=self._least)
        return self._bordered

    def _in_double_precision(self) -> LinearSolver:
        if self._exact is None:
            self._exact = linear_solver(self._model.pattern, np.float64)
        return self._exact
