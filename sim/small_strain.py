"""F_z of a straight, frictionless press at small strains: a few linear solves on a scene's mesh.

The gel follows Hooke's law about its shape at rest, the indenter stands at its depth from the
start, and only where it presses may touch: an active set of contact points, each a stiff spring.
What a mesh makes of that force is off by nearly what it makes of the real one (``sim.pilot``), for
a hundredth to a tenth of the time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.effects import plan_effects
from sim.linear_solver import linear_solver
from sim.model import Model
from sim.presets import build_model
from sim.scene import Scene

# How deep the indenter sinks into the springs under a pressure of E, over the pad's height.
_SPRING_SHARE = 2e-3
_ROUNDS_MAX = 12
_SETTLED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallStrainForce:
    """F_z [N], and how far from the axis the gel is touched [m]."""

    force_n: float
    reach_m: float


def small_strain_force(
    scene: Scene, *, depth_m: float, reach_m: float | None = None
) -> SmallStrainForce:
    """Return F_z of a scene's press to a depth at small strains, on the scene's mesh.

    Args:
        depth_m: Travel of the tip below first touch [m].
        reach_m: Where the gel is thought to be touched [m], which saves rounds; None starts from
            where the undeformed gel would lie inside the indenter.

    Raises:
        ConfigError: The scene cannot be meshed.
    """
    model = build_model(scene, plan=plan_effects(scene))
    bed = _bed(model, scene, depth_m)
    radii = bed.radii_m
    touching = bed.overlaps_m > 0.0 if reach_m is None else radii <= reach_m
    touching &= np.isfinite(bed.overlaps_m)
    solver = linear_solver(model.pattern, refined=False)
    force = 0.0
    for _ in range(_ROUNDS_MAX):
        springs = np.where(touching, bed.stiffness_n_m, 0.0)
        stiffness = np.zeros((*springs.shape, 3, 3))
        stiffness[..., 2, 2] = springs
        push = np.zeros((*springs.shape, 3))
        push[..., 2] = -springs * np.where(touching, bed.overlaps_m, 0.0)
        solver.factorise(model.hessian_data(model.nodes, stiffness, projected=False))
        moved = solver.solve(model.pattern.unknowns(model.scatter(push)))
        lifted = _at_points(model, model.pattern.nodal(moved)[:, 2])
        left = bed.overlaps_m + lifted
        before, force = force, float((springs * np.where(touching, left, 0.0)).sum())
        if abs(force - before) <= _SETTLED * abs(force):
            break
        touching = left > 0.0
    reach = float(radii[touching].max(initial=0.0))
    return SmallStrainForce(force_n=model.mesh.fold.copies * force, reach_m=reach)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bed:
    """Contact points of the undeformed gel; every array has the shape [face_count, point_count].

    Attributes:
        overlaps_m: How far each lies inside the indenter, negative outside, -inf beside it [m].
        radii_m: Distance from the indenter's axis [m].
        stiffness_n_m: Of each point's spring [N/m].
    """

    overlaps_m: FloatArray
    radii_m: NDArray[np.float64]
    stiffness_n_m: FloatArray


def _bed(model: Model, scene: Scene, depth_m: float) -> _Bed:
    x, y, z = (_at_points(model, model.nodes[:, axis]) for axis in range(3))
    x, y = x - scene.centre_m[0], y - scene.centre_m[1]
    above = z - scene.indenter.lower_surface(x, y)
    on_top = z > 0.5 * model.height_m
    highest = float(above[on_top].max())
    stiffness = model.contact_areas * model.young_pa / (_SPRING_SHARE * model.height_m)
    return _Bed(
        overlaps_m=np.where(on_top, above - highest + depth_m, -np.inf),
        radii_m=np.hypot(x, y),
        stiffness_n_m=stiffness,
    )


def _at_points(model: Model, nodal: FloatArray) -> FloatArray:
    """Return a nodal quantity at the contact points, shape [face_count, point_count]."""
    return np.asarray(nodal[model.faces] @ model.reference.face_values.T)
