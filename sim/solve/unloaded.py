"""The pad before anything touches it, where that is not its undeformed shape.

Weight, and a law with stress at rest, deform it: depth then counts from first touch of this shape.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.arrays import FloatArray
from sim.scene.indenter import Plane
from sim.solve.linear_solver import LinearSolver
from sim.solve.model import Model
from sim.solve.newton import NewtonOptions, equilibrate
from sim.solve.potentials import NodalPotential
from sim.solve.problem import Problem

_CLEARANCE_HEIGHTS = 10.0


def unloaded_positions(
    model: Model,
    solver: LinearSolver,
    *,
    options: NewtonOptions,
    potentials: Sequence[NodalPotential] = (),
) -> FloatArray:
    """Return the nodes at equilibrium without an indenter [m], shape [node_count, 3].

    Where nothing deforms the pad, these are the undeformed nodes and nothing is solved.

    Raises:
        ConvergenceError: No equilibrium was found.
    """
    stress = model.law.rest_stress(model.young_pa, model.poisson)
    if stress == 0.0 and not potentials:
        return model.nodes
    high = _CLEARANCE_HEIGHTS * float(model.nodes[:, 2].max())
    state = model.rest_state(tip=np.array([0.0, 0.0, high]))
    problem = Problem(model, solver, Plane(), potentials=potentials)
    equilibrate(problem, state, options=options)
    return state.positions
