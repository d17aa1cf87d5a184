"""What the forces of a twin are worth, found once before it follows anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.effects.coarse import CoarsePath
from sim.effects.outputs import outputs_of
from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.error.estimate import estimate_from, rung
from sim.scene.scene import Scene, Target
from sim.solve.loading_path import LoadingPath
from tacauchy_rig.core.errors import RigError

# Of the largest force: between them the error goes evenly.
_SHARES = (0.25, 0.5, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceWorth:
    """Relative error of F_z by force; nothing where nobody knows, and ``basis`` says why.

    Attributes:
        forces_n: Ascending [N].
        relative: At these.
    """

    forces_n: Sequence[float]
    relative: Sequence[float]
    basis: str

    def error_n(self, force_n: float) -> float | None:
        """Return what a force is worth [N]."""
        if not self.forces_n:
            return None
        return force_n * float(np.interp(force_n, self.forces_n, self.relative))


def force_worth(scene: Scene, path: LoadingPath, force_max_n: float) -> ForceWorth:
    """Press a path and preset fast's to some forces, and say what the former's are worth.

    On edges longer than preset fast's nothing is known of what is left (a punch is off by more than
    ``sim.error.estimate`` says there), so the difference to preset fast is measured, and what that
    is worth is added. The path is left at the largest force.

    Args:
        scene: As the path presses it, with preset fast on other edges.
        force_max_n: The largest force [N].
    """
    fast = replace(scene, refinement=1.0)
    plan = plan_effects(fast)
    forces, relative, basis = [share * force_max_n for share in _SHARES], [], ""
    try:
        finer, coarser = path_for(fast, plan), CoarsePath(*rung(fast, plan))
        for force in forces:
            aimed = replace(fast, target=Target(force_n=force))
            own, found = (outputs_of(each, each.push(force)) for each in (path, finer))
            worth = estimate_from(aimed, plan, found, coarser.push(force))
            if worth.force is None:
                return ForceWorth(forces_n=(), relative=(), basis=worth.basis)
            share = max(1.0, found.stiffness_n_m * found.depth_m / force)
            apart = share * abs(own.depth_m - found.depth_m) / found.depth_m
            relative.append(apart + worth.force)
            basis = f"{apart:.2%} off preset fast; of that {worth.basis}"
    except RigError as error:
        basis = f"the press on shorter edges failed: {error.message}"
        return ForceWorth(forces_n=(), relative=(), basis=basis)
    return ForceWorth(forces_n=forces, relative=relative, basis=basis)
