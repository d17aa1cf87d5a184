"""The pad that a batch is pressed into: as coarse as F_z to 3 % allows."""

from __future__ import annotations

from dataclasses import replace

from sim.effects.plan import plan_effects
from sim.effects.presets import BATCH, build_model, mesh_for
from sim.scene.scene import Effect, Scene
from sim.solve.model import Model

# A barrier of 1 % of the height makes F_z 1 % too large and halves Newton's iterations.
BARRIER_SHARE = 0.01


def batch_model(scene: Scene, *, refinement: float = 1.0, symmetric: bool = True) -> Model:
    """Mesh a scene's pad for a batch, on the CPU.

    Args:
        scene: Pad, gel and indenter; its target and its barrier do not matter.
        refinement: Make every edge this many times shorter.
        symmetric: Model a part where symmetry allows. No environment can then move or tilt the
            indenter.

    Raises:
        ConfigError: The pad cannot be meshed for this indenter.
    """
    scene = replace(
        scene,
        barrier_m=BARRIER_SHARE * scene.pad.height_m,
        effects=((Effect.FINITE_STRAIN, True), (Effect.LOCKING_FREE_ELEMENT, True)),
    )
    mesh = mesh_for(scene, symmetric=symmetric, refinement=refinement, resolution=BATCH)
    return build_model(scene, plan=plan_effects(scene), mesh=mesh)
