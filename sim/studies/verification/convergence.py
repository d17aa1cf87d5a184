"""How fast F_z converges: as every edge gets shorter, and as those at a sharp rim alone do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.effects.coarse import coarse_press
from sim.effects.plan import plan_effects
from sim.effects.presets import RESOLUTIONS, build_model, mesh_for
from sim.press_command import scene_from
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene.material import Material
from sim.scene.scene import Preset
from sim.solve.loading_path import LoadingPath
from sim.studies.verification.prose import stated
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.tables import Cell, Table, table_of_rows

# Coarser than 1, two edges and less lie under the ball, and F_z is not yet on any power of h.
REFINEMENTS = (1.0, 1.5, 2.0)
# What is pressed, and the least order that is asked.
_INDENTERS: tuple[tuple[Indenter, float], ...] = (
    (Cylinder(diameter_m=4e-3), 0.9),
    (Sphere(diameter_m=8e-3), 1.8),
)
_SCENE = scene_from(
    "--pad disc:radius=8mm,height=4mm --young 0.4MPa --poisson 0.48 "
    "--indenter cylinder:diameter=4mm --depth 0.1mm --effect finite-strain=on --preset fast"
)

_RIM = replace(_SCENE, material=Material(young_pa=2e5, poisson=0.47), preset=Preset.BALANCED)
# Edges at the rim in radii of the punch, and where their order has to lie.
EDGE_SHARES = (0.16, 0.08, 0.04, 0.02)
_LOWEST, _HIGHEST = 0.75, 1.5
_SECTORS = 40


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
    """Press a sharp punch and a ball on three meshes each."""
    rows: list[dict[str, Cell]] = []
    passed = True
    for indenter, wanted in _INDENTERS:
        scene = replace(_SCENE, indenter=indenter)
        plan = plan_effects(scene)
        forces = [
            float(coarse_press(scene, plan, factor).outputs.force_n[2]) for factor in REFINEMENTS
        ]
        headings = [f"F_z, edges 1/{factor:g} [N]" for factor in REFINEMENTS]
        row = _fitted_row(indenter, 1.0 / np.array(REFINEMENTS), forces, headings)
        rows.append(row | {"at least": wanted})
        passed &= float(row["order"] or 0.0) >= wanted
    return table_of_rows(rows, passed=passed, **stated("convergence"))


def _fitted_row(
    indenter: Indenter, edges: FloatArray, forces_n: Sequence[float], headings: Sequence[str]
) -> dict[str, Cell]:
    order, limit = fitted_order(edges, np.array(forces_n))
    forces = zip(headings, forces_n, strict=True)
    return {"indenter": describe(indenter), **dict(forces), "limit [N]": limit, "order": order}


def rim_forces(shares: Sequence[float] = EDGE_SHARES) -> tuple[float, ...]:
    """Return F_z with edges at the rim of so many radii, all else as preset balanced has it [N]."""
    plan = plan_effects(_RIM)
    forces = []
    for share in shares:
        resolution = replace(RESOLUTIONS[_RIM.preset], edge_share=share, sector_count=_SECTORS)
        mesh = mesh_for(_RIM, resolution=resolution)
        path = LoadingPath(build_model(_RIM, plan=plan, mesh=mesh), _RIM.indenter)
        point = path.advance(0.1e-3)
        forces.append(float(mesh.symmetry.whole_force(point.force_n)[2]))
    return tuple(forces)


def measure_rim() -> Table:
    """Fit the order to a sharp punch on four meshes."""
    headings = [f"F_z, edges of {share:g} radii [N]" for share in EDGE_SHARES]
    row = _fitted_row(_RIM.indenter, np.array(EDGE_SHARES), rim_forces(), headings)
    return table_of_rows(
        [row],
        passed=_LOWEST <= float(row["order"] or 0.0) <= _HIGHEST,
        **stated("rim", lowest=_LOWEST, highest=_HIGHEST),
    )
