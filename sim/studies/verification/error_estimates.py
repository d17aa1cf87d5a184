"""Does the true error of F_z lie inside the estimate, on scenes that the estimate never saw?"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sim.effects.plan import plan_effects
from sim.force_error_estimate import (
    COARSENINGS,
    CoarserForce,
    ForceErrorEstimate,
    estimate_from,
    force_on,
)
from sim.scene.indenter import Cylinder, Indenter, Sphere
from sim.scene.material import Layer, Material
from sim.scene.pad import BoxPad, DiscPad, Pad
from sim.scene.scene import ContactMode, Effect, Preset, Scene, Target
from tacauchy_rig.tables import Table, table_of

logger = logging.getLogger(__name__)

_INSIDE_WANTED = 0.9
_FINER = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinedPress:
    """One scene on four meshes.

    Attributes:
        name: Of the scene, for a table.
        force_n: F_z on the preset's mesh.
        finer_n: F_z on the mesh twice as fine.
    """

    name: str
    scene: Scene
    force_n: float
    finer_n: float
    coarser: tuple[CoarserForce, ...]

    @property
    def estimate(self) -> ForceErrorEstimate:
        """What is believed without the finer mesh; both meshes leave out the same effects."""
        return estimate_from(self.scene, self.force_n, self.coarser)

    @property
    def true_error(self) -> float:
        """Relative to the finer mesh."""
        return abs(self.force_n / self.finer_n - 1.0)

    @property
    def is_inside(self) -> bool:
        """The true error is not larger than the estimate."""
        estimated = self.estimate.relative
        return estimated is not None and self.true_error <= estimated


def refined_press(name: str, scene: Scene, *, finer: float = _FINER) -> RefinedPress:
    """Press a scene to its depth on its own mesh, on two coarser ones and on a finer one.

    Args:
        finer: How many times shorter the finer mesh's edges are.

    Raises:
        RigError: A mesh cannot be made or solved.
    """
    plan = plan_effects(scene)
    coarser = tuple(
        CoarserForce(ratio=ratio, force_n=force_on(scene, plan, refinement=1.0 / ratio))
        for ratio in COARSENINGS
    )
    found = RefinedPress(
        name=name,
        scene=scene,
        force_n=force_on(scene, plan, refinement=1.0),
        finer_n=force_on(scene, plan, refinement=finer),
        coarser=coarser,
    )
    believed = found.estimate.relative
    logger.info("%s: true error %.3g, believed %.3g", name, found.true_error, believed)
    return found


def measure() -> Table:
    """Press every scene that was held out on four meshes; ten take minutes."""
    return judged([refined_press(name, scene) for name, scene in HELD_OUT.items()])


def judged(found: Sequence[RefinedPress]) -> Table:
    """Return what was found, and whether enough lie inside their estimate."""
    inside = sum(press.is_inside for press in found)
    ratios = sorted((press.estimate.relative or 0.0) / press.true_error for press in found)
    return table_of(
        found,
        {
            "scene": lambda press: press.name,
            "preset": lambda press: press.scene.preset.value,
            "F_z [N]": lambda press: press.force_n,
            "F_z, edges half as long [N]": lambda press: press.finer_n,
            "true error": lambda press: press.true_error,
            "estimated_force_error_relative": lambda press: press.estimate.relative,
            "inside": lambda press: "yes" if press.is_inside else "no",
        },
        title="Estimated force error on scenes held out",
        criterion="the true error lies inside the estimate on at least nine scenes of ten",
        passed=inside >= _INSIDE_WANTED * len(found),
        note=f"inside on {inside} of {len(found)}; the estimate is "
        f"{ratios[len(ratios) // 2]:.1f} times the true error in the middle of the list",
        command="tacauchy-rig press --pad disc:radius=7mm,height=3.5mm --young 0.2MPa "
        "--poisson 0.47 --indenter cylinder:diameter=4mm --depth 0.1mm --preset fast "
        "--estimate-error",
    )


def _gel(young_pa: float, poisson: float) -> Material:
    return Material(young_pa=young_pa, poisson=poisson)


def _scene(pad: Pad, gel: Material, indenter: Indenter, depth_m: float) -> Scene:
    target = Target(depth_m=depth_m)
    return Scene(pad=pad, material=gel, indenter=indenter, target=target, preset=Preset.FAST)


def _bonded(scene: Scene) -> Scene:
    return replace(scene, contact=ContactMode.BONDED)


def _layered(scene: Scene, lower: tuple[float, Material], upper: tuple[float, Material]) -> Scene:
    layers = tuple(Layer(share=share, material=material) for share, material in (lower, upper))
    return replace(scene, layers=layers)


def _box(size_x_m: float, size_y_m: float, height_m: float) -> BoxPad:
    return BoxPad(size_x_m=size_x_m, size_y_m=size_y_m, height_m=height_m)


def _disc(radius_m: float, height_m: float) -> DiscPad:
    return DiscPad(radius_m=radius_m, height_m=height_m)


_STEEP = replace(_box(18e-3, 18e-3, 3.5e-3), dome_radius_x_m=0.06, dome_radius_y_m=0.08)
_SOFT = _gel(1e5, 0.46)

HELD_OUT = {
    "sharp 4 mm punch, disc 3.5 mm, nu 0.47": _scene(
        _disc(7e-3, 3.5e-3), _gel(2e5, 0.47), Cylinder(diameter_m=4e-3), 0.1e-3
    ),
    "sharp 6 mm punch, box 4.5 mm, nu 0.49": _scene(
        _box(22e-3, 18e-3, 4.5e-3), _gel(3e5, 0.49), Cylinder(diameter_m=6e-3), 0.12e-3
    ),
    "bonded sharp 5 mm punch, disc 5 mm, nu 0.42": _bonded(
        _scene(_disc(9e-3, 5e-3), _gel(3e5, 0.42), Cylinder(diameter_m=5e-3), 0.15e-3)
    ),
    "6 mm punch, 0.5 mm fillet, steep dome": _scene(
        _STEEP, _gel(2.5e5, 0.46), Cylinder(diameter_m=6e-3, fillet_m=0.5e-3), 0.15e-3
    ),
    "10 mm ball, 0.6 mm deep, nu 0.45": _scene(
        _disc(9e-3, 5e-3), _gel(3e5, 0.45), Sphere(diameter_m=10e-3), 0.6e-3
    ),
    "bonded 5 mm ball, small box, nu 0.48": _bonded(
        _scene(_box(14e-3, 14e-3, 3e-3), _gel(4e5, 0.48), Sphere(diameter_m=5e-3), 0.1e-3)
    ),
    "12 mm ball, nu 0.495, preset balanced": replace(
        _scene(_disc(8e-3, 3e-3), _gel(3e5, 0.495), Sphere(diameter_m=12e-3), 0.1e-3),
        preset=Preset.BALANCED,
    ),
    "7 mm ball, soft skin on a stiff base": _layered(
        _scene(_disc(8e-3, 4e-3), _SOFT, Sphere(diameter_m=7e-3), 0.15e-3),
        (0.5, _gel(6e5, 0.47)),
        (0.5, _gel(2e5, 0.47)),
    ),
    "6 mm ball 2 mm off the centre, friction 0.6": replace(
        _scene(_box(16e-3, 14e-3, 3.5e-3), _gel(3e5, 0.46), Sphere(diameter_m=6e-3), 0.2e-3),
        centre_m=(2e-3, 0.0),
        contact=ContactMode.FRICTION,
        friction=0.6,
        effects=((Effect.FRICTION, True),),
    ),
    "4 mm punch, 0.2 mm fillet, three times as stiff skin": _layered(
        _scene(_disc(7e-3, 4e-3), _SOFT, Cylinder(diameter_m=4e-3, fillet_m=0.2e-3), 0.12e-3),
        (0.8, _SOFT),
        (0.2, _gel(3e5, 0.46)),
    ),
}
