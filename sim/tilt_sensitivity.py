"""Sensitivity of a press to its inputs, from cheap coarse presses.

A tilt towards x is positive where the axis, from the tip upwards, points towards +x: a rotation by
the same angle about +y. One towards y is a rotation by minus that angle about x.

All that presses raises RigError where the scene cannot be meshed or solved.
"""

import hashlib
import pickle
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from sim.effects.effect_choice import output_tolerances, plan_effects
from sim.effects.planned_effects import full_plan
from sim.effects.press_outputs import PressOutputs, outputs_of
from sim.effects.press_with_effects import path_for
from sim.fields.pressure_and_shear import contact_measures
from sim.mesh.cached_tet_mesh import cache_folder
from sim.scene.indenter import Indenter, Sphere
from sim.scene.scene import Effect, Motion, Output, Preset, Scene, Target
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.store.atomic_write import write_atomically

# Of a 5 mm punch's force, nu + 0.01 changes 4.9 and 4.3 % on edges 0.7 and 1.0 times as short as
# preset fast's, and 4.2 % on preset balanced's; 0.1 mm of height 2.3, 2.5 and 2.3 %; 29 um of
# fillet 2.0, 0.7 and 0.9 %.
COARSE, FINER = 0.7, 1.0
NO_FORCE_N = 1e-5
"""Less is first touch [N]: the depth of a gel there is nanometres."""


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
    """
    if refinement is not None:
        scene = replace(
            scene, preset=Preset.FAST, refinement=refinement, outputs=frozenset(), tolerance=None
        )
    scene = replace(scene, target=Target(depth_m=max(depths_m)))
    plan = full_plan(scene)
    duration_s = scene.duration_s if plan.is_on(Effect.VISCOELASTICITY) else None
    path = path_for(scene, plan)
    touched_m = path.push(contact_force_n).depth_m if contact_force_n > NO_FORCE_N else 0.0
    forces_n = np.zeros(len(depths_m))
    for position in np.argsort(depths_m):
        if duration_s is not None:
            path = path_for(scene, plan, model=path.model)
        point = path.advance(touched_m + depths_m[position], duration_s=duration_s)
        forces_n[position] = point.force_n[2]
    return forces_n


@cache
def _program() -> bytes:
    """Return a digest of the simulator's source: another simulator may find other forces."""
    files = sorted(
        file for kind in ("*.py", "*.cu") for file in Path(str(resources.files("sim"))).rglob(kind)
    )
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).digest()


def kept(content: Any, count: int, find: Callable[[], FloatArray]) -> FloatArray:
    """Return numbers, shape [count], found anew unless this machine keeps them by their content."""
    digest = hashlib.sha256(pickle.dumps((content, _program()))).hexdigest()
    file = cache_folder().with_name("forces") / f"{digest[:24]}.txt"
    try:
        found = np.loadtxt(file, ndmin=1)
    except (OSError, ValueError):
        found = np.zeros(0)
    if found.shape != (count,):
        found = find()
        with suppress(RecordError):  # a folder that cannot be written costs only time
            write_atomically(file, "\n".join(map(repr, found.tolist())).encode())
    return found


def kept_forces(
    scene: Scene, depths_m: Sequence[float], *, refinement: float, contact_force_n: float = 0.0
) -> FloatArray:
    """Return what ``forces_at`` does, and keep it on this machine by its content."""
    scene = replace(scene, outputs=frozenset(), target=Target(depth_m=max(depths_m)))
    how = {"refinement": refinement, "contact_force_n": contact_force_n}
    content = (scene, tuple(depths_m), how)
    return kept(content, len(depths_m), lambda: forces_at(scene, depths_m, **how))


# Moments against a tilt are 2 to 4 % higher than with edges 0.7 times as long, in a quarter of the
# time. On coarser meshes they go up and down, and nothing can be extrapolated from them.
_MOMENT_REFINEMENT = 1.0
# Left out where the scene's plan does: mass makes a press one of sixty time steps.
_IN_TIME = (Effect.INERTIA, Effect.GRAVITY)


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltedPress:
    """A coarse press with an indenter that is tilted towards x."""

    history: tuple[tuple[float, float], ...]  # (depth [m], force [N]) of every force
    moments_nm: FloatArray  # on the indenter about its tip, against the tilt [N m], of every force
    outputs: PressOutputs  # at the largest force


def can_tilt(indenter: Indenter) -> bool:
    """Return whether a tilt changes a press: that of a ball it does not."""
    return not isinstance(indenter, Sphere)


def press_tilted(
    scene: Scene, forces_n: Sequence[float], tilt_rad: float, *, refinement: float = COARSE
) -> TiltedPress:
    """Press coarsely with an indenter that is tilted towards x [rad], to rising forces [N]."""
    plan = plan_effects(scene)
    negligible = {effect: False for effect in _IN_TIME if not plan.is_on(effect)}
    tilted = replace(
        scene,
        motion=Motion(tilt_rad=(0.0, tilt_rad)),
        centre_m=(0.0, 0.0),
        preset=Preset.FAST,
        refinement=refinement,
        effects=tuple({**dict(scene.effects), **negligible}.items()),
    )
    path = path_for(tilted, full_plan(tilted))
    points = [path.push(force_n) for force_n in forces_n]
    about_y = [contact_measures(path.model, each).moment_nm[1] for each in points]
    return TiltedPress(
        history=tuple((each.depth_m, float(each.force_n[2])) for each in points),
        moments_nm=-np.array(about_y),
        outputs=outputs_of(path, points[-1]),
    )


def restoring_moments(
    scene: Scene, forces_n: Sequence[float], tilt_rad: float
) -> tuple[FloatArray, TiltedPress]:
    """Return moments against a tilt of one radian at rising forces [N m], and a press for it."""
    force_only = replace(scene, outputs=frozenset({Output.FORCE}))
    pressed = press_tilted(force_only, forces_n, tilt_rad, refinement=_MOMENT_REFINEMENT)
    return pressed.moments_nm / tilt_rad, pressed


def tilt_costs(scene: Scene, force_n: float, tilt_rad: float) -> dict[Output, float]:
    """Return the relative error of every output that is asked for if a tilt is left out.

    Two presses tilted to either side have one mesh; their difference is twice that of each from
    an upright one.
    """
    there, back = (press_tilted(scene, [force_n], sign * tilt_rad) for sign in (1.0, -1.0))
    apart = there.outputs.differences(back.outputs)
    return {output: 0.5 * apart[output] for output in output_tolerances(scene)}
