"""The pad before anything touches it, and where an indenter that comes down first feels it.

Weight, and a law with stress at rest, deform it; depths count from first touch of that shape.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.scene.indenter import Indenter, Plane
from sim.solve.equilibrium import EquilibriumSolver, SolverOptions
from sim.solve.model import Model
from sim.solve.potential import Potential
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# Height of an indenter that touches nothing, in heights of the pad.
_CLEARANCE_HEIGHTS = 10.0
# Of the pad's height: how closely first touch is found.
_EXACT_SHARE, _TRIES = 2.5e-10, 100


def unloaded_positions(
    model: Model,
    *,
    options: SolverOptions,
    potentials: Sequence[Potential] = (),
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
    EquilibriumSolver(model, Plane(), potentials).settle(state, options=options)
    return state.positions


def touch_height(
    model: Model,
    indenter: Indenter,
    unloaded: FloatArray,
    *,
    centre_m: tuple[float, float],
    rotation: FloatArray,
) -> float:
    """Return the tip height at which the unloaded pad is first felt [m]: a gap of d_hat.

    Counted from there, a press depends on d_hat ten times less than counted from gap zero: the
    gel then stays d_hat (1 - s) off, s near 1, instead of d_hat s.

    Args:
        unloaded: Nodes of the pad before it is touched [m], shape [node_count, 3].

    Raises:
        ConfigError: The indenter comes down beside the pad.
    """
    high = float(unloaded[:, 2].max())
    distance = model.contact_options.distance_m
    state = model.rest_state(tip=np.array([*centre_m, high]), rotation=rotation)
    for _ in range(_TRIES):
        gap = float(model.surface.gaps(unloaded, indenter, state).min()) - distance
        if abs(gap) < _EXACT_SHARE * model.height_m:
            break
        state.tip[2] -= gap
        if state.tip[2] < 0.0:
            x, y = centre_m
            raise ConfigError(
                f"the indenter at x = {x * 1e3:.4g} mm, y = {y * 1e3:.4g} mm comes down beside "
                "the pad and never touches its top",
                remedy="move it over the pad",
            )
    return float(state.tip[2])
