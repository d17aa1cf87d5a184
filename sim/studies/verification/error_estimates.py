"""Does the true error of F_z lie inside the estimate, on scenes that the estimate never saw?"""

from __future__ import annotations

import logging
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib import resources

from sim.effects.coarse import coarse_press
from sim.effects.plan import plan_effects
from sim.error.estimate import estimated
from sim.press_command import scene_from
from sim.scene.pad import BoxPad
from sim.scene.scene import Scene
from sim.studies.verification.prose import stated
from tacauchy_rig.core.tables import Cell, Table, table_of_rows

logger = logging.getLogger(__name__)

_INSIDE_WANTED = 0.9
_FINER = 2.0
_FILE = "held_out.toml"
BELIEVED = "estimated_force_error_relative"


def refined_press(name: str, scene: Scene, *, finer: float = _FINER) -> dict[str, Cell]:
    """Press a scene to its depth on its own mesh, on a coarser one and on a finer one.

    Args:
        finer: How many times shorter the finer mesh's edges are.

    Raises:
        RigError: A mesh cannot be made or solved.
    """
    plan = plan_effects(scene)
    own, fine = (coarse_press(scene, plan, factor).outputs for factor in (1.0, finer))
    believed = estimated(scene, plan, own).force
    return estimate_row(name, scene, float(own.force_n[2]), float(fine.force_n[2]), believed)


def estimate_row(
    name: str, scene: Scene, force_n: float, finer_n: float, believed: float | None
) -> dict[str, Cell]:
    """Return the true error of F_z beside what is believed without the finer mesh.

    Both meshes leave out the same effects.
    """
    error = abs(force_n / finer_n - 1.0)
    logger.info("%s: true error %.3g, believed %s", name, error, believed)
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


def _held_out() -> Iterator[tuple[str, Scene]]:
    """Read the scenes with their names; a dome is what no word says."""
    text = resources.files("sim.studies.verification.data").joinpath(_FILE).read_text("utf-8")
    for name, given in tomllib.loads(text).items():
        scene = scene_from(given["press"])
        if "dome_radii_m" in given and isinstance(scene.pad, BoxPad):
            x_m, y_m = given["dome_radii_m"]
            pad = replace(scene.pad, dome_radius_x_m=x_m, dome_radius_y_m=y_m)
            scene = replace(scene, pad=pad)
        yield name, scene


HELD_OUT = dict(_held_out())
