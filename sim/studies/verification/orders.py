"""How fast F_z converges as every edge gets shorter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.arrays import FloatArray
from sim.effects.plan import plan_effects
from sim.force_error_estimate import force_on
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Effect, Preset, Scene, Target
from tacauchy_rig.tables import Table

# Coarser than 1, two edges and less lie under the ball, and F_z is not yet on any power of h.
REFINEMENTS = (1.0, 1.5, 2.0)
_SCENE = Scene(
    pad=DiscPad(radius_m=8e-3, height_m=4e-3),
    material=Material(young_pa=4e5, poisson=0.48),
    indenter=Cylinder(diameter_m=4e-3),
    target=Target(depth_m=0.1e-3),
    preset=Preset.FAST,
    effects=((Effect.FINITE_STRAIN, True),),
)
_INDENTERS: tuple[tuple[Indenter, float], ...] = (
    (Cylinder(diameter_m=4e-3), 0.9),
    (Sphere(diameter_m=8e-3), 1.8),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ConvergenceOrder:
    """F_z of one scene on meshes of different fineness.

    Attributes:
        order: p of the fit F = limit + C h^p.
        limit_n: F_z as h goes to zero, by the fit [N].
        order_wanted: The least that is asked.
    """

    indenter: str
    refinements: tuple[float, ...]
    forces_n: tuple[float, ...]
    order: float
    limit_n: float
    order_wanted: float


def convergence_orders() -> tuple[ConvergenceOrder, ...]:
    """Press a sharp punch and a ball on three meshes each."""
    found = []
    for indenter, wanted in _INDENTERS:
        scene = replace(_SCENE, indenter=indenter)
        plan = plan_effects(scene)
        forces = tuple(force_on(scene, plan, refinement=factor) for factor in REFINEMENTS)
        order, limit = fitted_order(1.0 / np.array(REFINEMENTS), np.array(forces))
        found.append(
            ConvergenceOrder(
                indenter=describe(indenter),
                refinements=REFINEMENTS,
                forces_n=forces,
                order=order,
                limit_n=limit,
                order_wanted=wanted,
            )
        )
    return tuple(found)


def fitted_order(edges: FloatArray, forces_n: FloatArray) -> tuple[float, float]:
    """Return p and the limit of F = limit + C h^p, least squares weighted by 1 / h.

    Args:
        edges: Edge lengths h in any unit, at least three.
        forces_n: F_z on each mesh [N].
    """
    weight = 1.0 / edges
    best = (np.inf, 0.0, 0.0)
    for order in np.arange(0.2, 6.0, 0.01):
        columns = np.column_stack([np.ones_like(edges), edges**order])
        solution = np.linalg.lstsq(columns * weight[:, None], forces_n * weight, rcond=None)[0]
        misfit = float(np.linalg.norm((columns @ solution - forces_n) * weight))
        best = min(best, (misfit, float(order), float(solution[0])))
    return best[1], best[2]


def measure() -> Table:
    """Return the orders as a table."""
    found = convergence_orders()
    return Table(
        title="Order of convergence of F_z",
        columns=(
            "indenter",
            *(f"F_z, edges 1/{factor:g} [N]" for factor in REFINEMENTS),
            "limit [N]",
            "order",
            "at least",
        ),
        rows=tuple(
            (row.indenter, *row.forces_n, row.limit_n, row.order, row.order_wanted) for row in found
        ),
        criterion="about 1 (at least 0.9) under a sharp rim, at least 1.8 under a ball",
        passed=all(row.order >= row.order_wanted for row in found),
        note=(
            "the fit is F = limit + C h^p; under a sharp rim an order above 1 says that the rim's "
            "own edges, which refine at order 1, are not yet what is missing most"
        ),
    )
