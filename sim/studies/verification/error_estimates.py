"""Does the true error of F_z lie inside the estimate, on scenes that the estimate never saw?"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

from sim.effects.plan import plan_effects
from sim.force_error_estimate import (
    COARSENINGS,
    CoarserForce,
    estimate_from,
    force_on,
)
from sim.press_command import scene_from
from sim.scene.material import Material
from sim.scene.pad import BoxPad
from sim.scene.scene import Scene
from sim.studies.verification.prose import stated
from tacauchy_rig.tables import Cell, Table, table_of_rows

logger = logging.getLogger(__name__)

_INSIDE_WANTED = 0.9
_FINER = 2.0
BELIEVED = "estimated_force_error_relative"


def refined_press(name: str, scene: Scene, *, finer: float = _FINER) -> dict[str, Cell]:
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
    own, fine = (force_on(scene, plan, refinement=factor) for factor in (1.0, finer))
    return estimate_row(name, scene, own, fine, coarser)


def estimate_row(
    name: str, scene: Scene, force_n: float, finer_n: float, coarser: tuple[CoarserForce, ...]
) -> dict[str, Cell]:
    """Return the true error of F_z beside what is believed without the finer mesh.

    Both meshes leave out the same effects.
    """
    error = abs(force_n / finer_n - 1.0)
    believed = estimate_from(scene, force_n, coarser).relative
    logger.info("%s: true error %.3g, believed %.3g", name, error, believed)
    return {
        "scene": name,
        "preset": scene.preset.value,
        "F_z [N]": force_n,
        "F_z, edges half as long [N]": finer_n,
        "true error": error,
        BELIEVED: believed,
        "inside": "yes" if believed is not None and error <= believed else "no",
    }


def measure() -> Table:
    """Press every scene that was held out on four meshes; ten take minutes."""
    return judged([refined_press(name, scene) for name, scene in HELD_OUT.items()])


def judged(rows: Sequence[dict[str, Cell]]) -> Table:
    """Return what was found, and whether enough lie inside their estimate."""
    inside = sum(row["inside"] == "yes" for row in rows)
    pairs = [(float(row[BELIEVED] or 0.0), float(row["true error"] or 0.0)) for row in rows]
    ratios = sorted(believed / error for believed, error in pairs)
    return table_of_rows(
        rows,
        passed=inside >= _INSIDE_WANTED * len(rows),
        command="tacauchy-rig press --pad disc:radius=7mm,height=3.5mm --young 0.2MPa "
        "--poisson 0.47 --indenter cylinder:diameter=4mm --depth 0.1mm --preset fast "
        "--estimate-error",
        **stated("estimates", inside=inside, count=len(rows), ratio=ratios[len(ratios) // 2]),
    )


_STEEP = BoxPad(
    size_x_m=18e-3, size_y_m=18e-3, height_m=3.5e-3, dome_radius_x_m=0.06, dome_radius_y_m=0.08
)
# The gel by which a layered scene's weight and expected depth are judged.
_SOFT = Material(young_pa=1e5, poisson=0.46)

HELD_OUT = {
    "sharp 4 mm punch, disc 3.5 mm, nu 0.47": scene_from(
        "--pad disc:radius=7mm,height=3.5mm --young 0.2MPa --poisson 0.47 "
        "--indenter cylinder:diameter=4mm --depth 0.1mm --preset fast"
    ),
    "sharp 6 mm punch, box 4.5 mm, nu 0.49": scene_from(
        "--pad box:22x18x4.5mm --young 0.3MPa --poisson 0.49 "
        "--indenter cylinder:diameter=6mm --depth 0.12mm --preset fast"
    ),
    "bonded sharp 5 mm punch, disc 5 mm, nu 0.42": scene_from(
        "--pad disc:radius=9mm,height=5mm --young 0.3MPa --poisson 0.42 "
        "--indenter cylinder:diameter=5mm --depth 0.15mm --contact bonded --preset fast"
    ),
    "6 mm punch, 0.5 mm fillet, steep dome": replace(
        scene_from(
            "--pad box:18x18x3.5mm --young 0.25MPa --poisson 0.46 "
            "--indenter cylinder:diameter=6mm,fillet=0.5mm --depth 0.15mm --preset fast"
        ),
        pad=_STEEP,
    ),
    "10 mm ball, 0.6 mm deep, nu 0.45": scene_from(
        "--pad disc:radius=9mm,height=5mm --young 0.3MPa --poisson 0.45 "
        "--indenter sphere:diameter=10mm --depth 0.6mm --preset fast"
    ),
    "bonded 5 mm ball, small box, nu 0.48": scene_from(
        "--pad box:14x14x3mm --young 0.4MPa --poisson 0.48 "
        "--indenter sphere:diameter=5mm --depth 0.1mm --contact bonded --preset fast"
    ),
    "12 mm ball, nu 0.495, preset balanced": scene_from(
        "--pad disc:radius=8mm,height=3mm --young 0.3MPa --poisson 0.495 "
        "--indenter sphere:diameter=12mm --depth 0.1mm"
    ),
    "7 mm ball, soft skin on a stiff base": replace(
        scene_from(
            "--pad disc:radius=8mm,height=4mm --layer share=0.5,young=0.6MPa,poisson=0.47 "
            "--layer share=0.5,young=0.2MPa,poisson=0.47 "
            "--indenter sphere:diameter=7mm --depth 0.15mm --preset fast"
        ),
        material=_SOFT,
    ),
    "6 mm ball 2 mm off the centre, friction 0.6": scene_from(
        "--pad box:16x14x3.5mm --young 0.3MPa --poisson 0.46 --indenter sphere:diameter=6mm "
        "--at 2mm --depth 0.2mm --contact friction:0.6 --effect friction=on --preset fast"
    ),
    "4 mm punch, 0.2 mm fillet, three times as stiff skin": replace(
        scene_from(
            "--pad disc:radius=7mm,height=4mm --layer share=0.8,young=0.1MPa,poisson=0.46 "
            "--layer share=0.2,young=0.3MPa,poisson=0.46 "
            "--indenter cylinder:diameter=4mm,fillet=0.2mm --depth 0.12mm --preset fast"
        ),
        material=_SOFT,
    ),
}
