"""Do indenter, clamp and load carry the same force, and does the surface's stress?"""

from __future__ import annotations

from collections.abc import Mapping

from sim.effects.presets import build_model
from sim.press import press
from sim.press_command import scene_from
from sim.scene.scene import Scene
from sim.studies.verification.prose import stated
from tacauchy_rig.core.tables import Table, table_of_rows

_LIMIT = 1e-6
REFINEMENTS = (1.0, 1.5)
# Headings of what is judged.
BASE, LOAD, GAP = "indenter and base", "indenter and load", "smallest gap [um]"
TRACTION_GAPS = [f"surface_traction_gap_relative, edges 1/{factor:g}" for factor in REFINEMENTS]
_GEL = "--pad box:20x24x4mm --young 0.4MPa --poisson 0.48 --preset fast"
_PRESSES = {
    "sharp punch to a depth": "--indenter cylinder:diameter=5mm --depth 0.2mm",
    "sharp punch to a load": "--indenter cylinder:diameter=5mm --force 1N",
    "filleted punch to a load": "--indenter cylinder:diameter=5mm,fillet=0.1mm --force 1N",
    "ball to a load": "--indenter sphere:diameter=8mm --force 0.4N",
    "bonded ball": "--indenter sphere:diameter=8mm --depth 0.2mm --contact bonded",
    "ball with friction 0.5": "--indenter sphere:diameter=8mm --depth 0.2mm "
    "--contact friction:0.5 --effect friction=on",
}
_SCENES = {name: scene_from(f"{_GEL} {words}") for name, words in _PRESSES.items()}
_SCENES["ball on two layers"] = scene_from(
    "--pad box:20x24x4mm --layer share=0.75,young=0.1MPa,poisson=0.46 "
    "--layer share=0.25,young=0.4MPa,poisson=0.46 --indenter sphere:diameter=8mm --depth 0.2mm "
    "--preset fast"
)


def balanced_press(scene: Scene) -> dict[str, float | None]:
    """Press a scene on its own mesh and on a finer one; count its force in four ways.

    Returns:
        By the table's headings: F_z [N]; force + base reaction and force - load, over the force,
        the latter None where a depth was asked for; surface_traction_gap_relative on both meshes;
        the smallest gap [um].
    """
    results = [press(scene, model=build_model(scene, refinement=factor)) for factor in REFINEMENTS]
    load = scene.target.force_n
    off_load = [abs(result.force_n[2] / load - 1.0) for result in results] if load else [None]
    gaps = [result.surface_traction_gap_relative for result in results]
    return {
        "F_z [N]": results[0].force_n[2],
        BASE: max(result.force_balance_relative for result in results),
        LOAD: max(off_load, key=lambda off: off or 0.0),
        **dict(zip(TRACTION_GAPS, gaps, strict=True)),
        GAP: 1e6 * min(result.gap_min_m for result in results),
    }


def is_balanced(row: Mapping[str, float | None]) -> bool:
    """Indenter, base and load agree to 1e-6, and nothing overlaps."""
    return max(row[BASE] or 0.0, row[LOAD] or 0.0) < _LIMIT and (row[GAP] or 0.0) > 0.0


def measure() -> Table:
    """Press the scenes and compare."""
    found = {name: balanced_press(scene) for name, scene in _SCENES.items()}
    worst = [max(row[name] or 0.0 for row in found.values()) for name in TRACTION_GAPS]
    return table_of_rows(
        [{"press": name, **row} for name, row in found.items()],
        passed=all(map(is_balanced, found.values())) and worst[-1] < worst[0],
        command="tacauchy-rig press --pad box:20x24x4mm --young 0.4MPa --poisson 0.48 "
        "--indenter cylinder:diameter=5mm --force 1N --preset fast",
        **stated("balance", worst=worst),
    )
