"""What a depth's force is on a coarse mesh: cheap enough to try what every input changes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.effects.effect_plan import full_plan
from sim.effects.scene_path import path_for
from sim.scene.scene import Effect, Preset, Scene, Target
from tacauchy_rig.core.arrays import FloatArray

# What an input changes of a 5 mm punch's force, 0.5 mm deep in a GelSight Mini, fillet 0.1 mm, mu
# 0.5; edges of preset fast so many times shorter (the seconds are of all of them):
#                 0.7 (2 s)  1.0 (6 s)  1.4 (16 s)  preset balanced (46 s)
# nu + 0.01          4.9        4.3        4.3          4.2 %
# height + 0.1 mm   -2.3       -2.5       -2.5         -2.3 %
# diameter + 29 um   1.1        1.1        1.1          1.1 %
# fillet + 29 um    -2.0       -0.7       -0.8         -0.9 %
# tilt 1.6 deg      -6.9       -6.5       -6.4           -
# Longer edges stay too stiff at a fillet and where a gel hardly changes its volume.
COARSE, FINER = 0.7, 1.0
# Less is first touch [N]: the depth of a gel there is nanometres.
_NO_FORCE_N = 1e-5


def forces_at(
    scene: Scene,
    depths_m: Sequence[float],
    *,
    contact_force_n: float = 0.0,
    refinement: float | None = None,
) -> FloatArray:
    """Press a scene's indenter to depths [m], and return F_z at each [N], shape [depth_count].

    A gel that relaxes is pressed anew for each depth, in the scene's time.

    Args:
        contact_force_n: Force from which depths count [N]; 0 is first touch.
        refinement: Coarsely, every edge this many times shorter than preset fast's; None presses
            on the scene's own mesh.

    Raises:
        RigError: It cannot be meshed or solved.
    """
    if refinement is not None:
        scene = replace(
            scene, preset=Preset.FAST, refinement=refinement, outputs=frozenset(), tolerance=None
        )
    scene = replace(scene, target=Target(depth_m=max(depths_m)))
    plan = full_plan(scene)
    duration_s = scene.duration_s if plan.is_on(Effect.VISCOELASTICITY) else None
    path = path_for(scene, plan)
    touched_m = path.push(contact_force_n).depth_m if contact_force_n > _NO_FORCE_N else 0.0
    forces_n = np.zeros(len(depths_m))
    for position in np.argsort(depths_m):
        if duration_s is not None:
            path = path_for(scene, plan, model=path.model)
        point = path.advance(touched_m + depths_m[position], duration_s=duration_s)
        forces_n[position] = point.force_n[2]
    return forces_n
