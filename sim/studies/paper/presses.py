"""The paper's model as it states it, pressed beside ours with the same gel, punch and friction."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.effects.plan import plan_effects
from sim.effects.presets import build_model
from sim.effects.scene_path import follow, path_for
from sim.fields.stress import surface_stress
from sim.press import PressResult, measure, press
from sim.press_command import scene_from
from sim.scene.material import LawName
from sim.scene.scene import Drive, Preset, Scene, Target

# Its punch and friction; the rim's fillet and the gel's modulus, which it does not state, are ours.
PUNCH = (
    "--sensor gelsight-mini --indenter cylinder:diameter=5mm,fillet=0.1mm --contact friction:0.5"
)
# d_hat of section III-B [m].
BARRIER_M = 1e-3
# The paper names the ends of six forces (IV-B); those between are evenly spaced, as in a run [N].
FORCES_N = (1.2556, 1.9511, 2.6466, 3.3422, 4.0377, 4.7332)
# Where F_z of all models is compared [m].
DEPTH_M = 0.5e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Pressed:
    """What one press of a model gave.

    Attributes:
        force_n: F_z [N].
        off_n: How far it is off the force that was asked for [N]; 0 where a depth was.
        depth_m: Travel below first touch, which is d_hat above the gel [m].
        gap_m: Between gel and indenter at the closest [m].
        radius_m: Of the contact [m].
        sigma_off: sigma n summed over the contact off the contact force, as a share.
    """

    force_n: float
    off_n: float
    depth_m: float
    gap_m: float
    radius_m: float
    sigma_off: float
    newton_iterations: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelPresses:
    """One model pressed to the depth and to the forces.

    Attributes:
        name: Of the model, for a table.
        at_depth: Pressed ``DEPTH_M`` deep.
        at_forces: Pressed to each force.
    """

    name: str
    at_depth: Pressed
    at_forces: tuple[Pressed, ...] = ()

    @property
    def sigma_off_most(self) -> float:
        """The largest share by which sigma n misses the contact force."""
        return max(each.sigma_off for each in (self.at_depth, *self.at_forces))


AS_CONFIGURED = "the paper's, as configured: d_hat 1 mm"
THIN = "its mesh, our d_hat"
FAST, BALANCED, ACCURATE = "our fast", "our balanced", "our accurate"


def scenes() -> dict[str, Scene]:
    """Return the models by name, each as a scene without its own target."""
    base = scene_from(f"{PUNCH} --depth {DEPTH_M * 1e3:g}mm --preset fast")
    paper = replace(base, preset=Preset.PAPER)
    return {
        AS_CONFIGURED: replace(paper, barrier_m=BARRIER_M),
        THIN: paper,
        FAST: base,
        BALANCED: replace(base, preset=Preset.BALANCED),
        ACCURATE: replace(base, preset=Preset.ACCURATE),
    }


def pressed(name: str, scene: Scene, *, forces_n: Sequence[float] = FORCES_N) -> ModelPresses:
    """Press a model to the depth, and anew to each force by moving the indenter as the paper does.

    Args:
        forces_n: Rising [N]; each press goes on from the one before.

    Raises:
        ConvergenceError: A press finds no equilibrium.
    """
    return ModelPresses(
        name=name,
        at_depth=_found(press(replace(scene, target=Target(depth_m=DEPTH_M)))),
        at_forces=tuple(_at_forces(scene, forces_n)),
    )


def _at_forces(scene: Scene, forces_n: Sequence[float]) -> Iterator[Pressed]:
    plan = plan_effects(scene)
    path = path_for(scene, plan)
    before = 0
    for force in forces_n:
        wanted = replace(scene, target=Target(force_n=force), drive=Drive.SEARCH)
        result = measure(wanted, path, follow(wanted, path), plan=plan, wall_s={})
        yield replace(
            _found(result),
            off_n=abs(result.force_n[2] - force),
            newton_iterations=result.newton_iterations - before,
        )
        before = result.newton_iterations


def _found(result: PressResult) -> Pressed:
    return Pressed(
        force_n=result.force_n[2],
        off_n=0.0,
        depth_m=result.depth_m,
        gap_m=result.gap_min_m,
        radius_m=result.contact_radius_m,
        sigma_off=result.surface_traction_gap_relative,
        newton_iterations=result.newton_iterations,
    )


def rest_stress_pa(law: LawName) -> float:
    """Return the normal stress that a law leaves in the gel at rest, by Algorithm 1 [Pa]."""
    scene = scenes()[THIN]
    model = build_model(replace(scene, material=replace(scene.material, law=law)))
    stress = surface_stress(model, model.nodes)
    return float(np.median(stress.normal_pa))
