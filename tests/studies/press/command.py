"""``python -m tests.studies press``: does one press tell an aged gel from a good one?"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from drivers.emulators.plant.gel_image_and_lights import GelCamera
from drivers.emulators.plant.gel_response import Plant
from drivers.emulators.plant.truth import CylinderTip, PlantTruth, draw_truth
from tacauchy_rig.app.cli.output import Found, show_table
from tacauchy_rig.app.gel_health import Advice, GelState, PressMeasures, compare_presses
from tacauchy_rig.core.config.settings import DEPTH_ERROR_M, RobotModel
from tacauchy_rig.core.tables import Table, table_of_rows

TARGET_N = 2.0
STIFFER, DIMMER = 1.15, 0.8
_SAMPLES = 200
_FRAMES = 25  # a dwell's, whose median is taken
_ZERO_N = 0.05
_SIZE_PX = (320, 240)
_ERROR_M = DEPTH_ERROR_M[RobotModel.E_SERIES]


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """What was said of one sensor."""

    seed: int
    aged: bool
    state: GelState

    @property
    def is_right(self) -> bool:
        """True where an aged gel is to be replaced and a good one kept."""
        return self.state.advice is (Advice.REPLACE if self.aged else Advice.KEEP)


def judged(seed: int, *, aged: bool) -> Judged:
    """Press a drawn sensor before and now, and judge it."""
    truth = draw_truth(seed)
    later = truth
    if aged:
        red, green, blue = truth.light_gain
        later = replace(
            truth,
            young_pa=STIFFER * truth.young_pa,
            light_gain=(DIMMER * red, DIMMER * green, DIMMER * blue),
        )
    random = np.random.default_rng([seed, 5, int(aged)])
    state = compare_presses(
        _seen(truth, random), _seen(later, random), depth_uncertainty_m=_ERROR_M
    )
    return Judged(seed=seed, aged=aged, state=state)


def _seen(truth: PlantTruth, random: np.random.Generator) -> PressMeasures:
    plant = Plant(truth, CylinderTip(diameter_m=5e-3))
    tried_m = np.linspace(0.0, 0.9e-3, 400)
    forces_n = np.array([plant.relaxed(float(each))[0] for each in tried_m])
    deepest_m = float(np.interp(TARGET_N, forces_n, tried_m))
    depth_m = np.linspace(0.0, deepest_m, _SAMPLES)
    force_n = np.interp(depth_m, tried_m, forces_n)
    light = 1.0 + truth.light_drift_ratio * float(random.uniform(0.0, 1.0))
    camera = GelCamera(truth, _SIZE_PX)
    noise = truth.image_noise_levels * 1.25 / np.sqrt(_FRAMES)  # of a median of frames
    unloaded, pressed = (
        camera.render(profile, light=light).astype(np.float64)
        for profile in (None, plant.surface_at(deepest_m, (0.0, 0.0), truth.tilt_rad))
    )
    return PressMeasures(
        depth_m=depth_m + random.normal(0.0, _ERROR_M),
        force_n=force_n + random.normal(0.0, truth.force_noise_n, _SAMPLES),
        unloaded=unloaded + random.normal(0.0, noise, unloaded.shape),
        pressed=pressed + random.normal(0.0, noise, pressed.shape),
        zero_n=truth.force_offset_n[2] + random.normal(0.0, _ZERO_N),
        zero_deviation_n=truth.force_noise_n,
    )


def state_table(found: Sequence[Judged]) -> Table:
    """Return one line a sensor."""
    rows = [
        {
            "seed": each.seed,
            "gel": "aged" if each.aged else "good",
            "said": each.state.advice.value,
            "modulus [%]": round(100.0 * modulus.value, 1),
            "+- [%]": round(100.0 * modulus.uncertainty, 1),
            "light [%]": round(100.0 * light.value, 1),
            "image [%]": round(100.0 * image.value, 1),
            "zero [N]": round(zero.value, 3),
        }
        for each in found
        for modulus, light, image, zero, *_ in [each.state.changes]
    ]
    return table_of_rows(
        rows,
        title="Good and aged gels, judged by one press beside one of before",
        criterion="aged gels are to be replaced, good ones kept",
        passed=all(each.is_right for each in found),
        command="python -m tests.studies press",
    )


def press_check(
    gels: Annotated[int, typer.Option("--gels", min=1, help="Of each kind.")] = 10,
    seed: Annotated[int, typer.Option("--seed", help="Of the first of them.")] = 1,
) -> Found:
    """Judge emulated gels, good ones and aged ones, as `check-press` does.

    Example: python -m tests.studies press --gels 10
    """
    seeds = range(seed, seed + gels)
    found = [judged(number, aged=aged) for aged in (False, True) for number in seeds]
    table = state_table(found)
    show_table(table)
    return Found({"table": table, "gels": found}, passed=table.passed)
