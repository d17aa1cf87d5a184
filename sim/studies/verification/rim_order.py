"""How fast F_z converges under a sharp rim as the rim's own edges get shorter and no others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.effects.plan import plan_effects
from sim.effects.presets import RESOLUTIONS, build_model, mesh_for
from sim.scene.indenter import Cylinder, describe
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Effect, Preset, Scene, Target
from sim.solve.load_steps.path import LoadingPath
from sim.studies.verification.orders import fitted_order
from tacauchy_rig.tables import Table

EDGE_SHARES = (0.16, 0.08, 0.04, 0.02)
LOWEST, HIGHEST = 0.75, 1.5
_SECTORS = 40
_SCENE = Scene(
    pad=DiscPad(radius_m=8e-3, height_m=4e-3),
    material=Material(young_pa=2e5, poisson=0.47),
    indenter=Cylinder(diameter_m=4e-3),
    target=Target(depth_m=0.1e-3),
    preset=Preset.BALANCED,
    effects=((Effect.FINITE_STRAIN, True),),
)


def rim_forces(shares: Sequence[float] = EDGE_SHARES) -> tuple[float, ...]:
    """Return F_z with edges at the rim of so many radii, all else as preset balanced has it [N]."""
    plan = plan_effects(_SCENE)
    forces = []
    for share in shares:
        resolution = replace(RESOLUTIONS[_SCENE.preset], edge_share=share, sector_count=_SECTORS)
        mesh = mesh_for(_SCENE, resolution=resolution)
        path = LoadingPath(build_model(_SCENE, plan=plan, mesh=mesh), _SCENE.indenter)
        point = path.advance(0.1e-3)
        forces.append(float(mesh.symmetry.whole_force(point.force_n)[2]))
    return tuple(forces)


def measure() -> Table:
    """Fit the order to a sharp punch on four meshes."""
    forces = rim_forces()
    order, limit = fitted_order(np.array(EDGE_SHARES), np.array(forces))
    return Table(
        title="Order of convergence at a sharp rim",
        columns=(
            "indenter",
            *(f"F_z, edges of {share:g} radii [N]" for share in EDGE_SHARES),
            "limit [N]",
            "order",
        ),
        rows=((describe(_SCENE.indenter), *forces, limit, order),),
        criterion=f"about 1: between {LOWEST:g} and {HIGHEST:g}",
        passed=LOWEST <= order <= HIGHEST,
        note="Only the edges at the rim are refined, and those that grow from them. Stress goes "
        "there with the inverse root of the distance, so that the energy's error, and with it "
        "F_z's, goes with the edge length whatever the element.",
    )
