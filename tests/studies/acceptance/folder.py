"""A folder as a lab leaves it: a DIGIT pressed at many places, and a table from a spreadsheet."""

import math
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

import cv2
import numpy as np

from drivers.emulators.plant.ball_presses import touched_at
from drivers.emulators.plant.gel_image_and_lights import render_press
from drivers.emulators.plant.gel_response import Plant
from drivers.emulators.plant.truth import CylinderTip, PlantTruth, SphereTip, Tip, draw_truth
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.cli.emulated_calibration import emulated_unit
from tacauchy_rig.core.arrays import FloatArray

SENSOR = "digit"
TOOLS: dict[str, Tip] = {
    "Kugel 6mm": SphereTip(diameter_m=6e-3),
    "Kugel 8mm": SphereTip(diameter_m=8e-3),
    "Stempel 4mm": CylinderTip(diameter_m=4e-3),
}
_SIZE = (640, 480)
_HEAD = "Nr;Zeit;Zustand;Bild;Stempel;x_mm;y_mm;Tiefe_mm;Kraft_gf"
_GF = 9.80665e-3  # [N]
_REST_FRAMES = 4  # averaged
_REACH = 0.45  # of half the image: the whole contact is seen
_MIDDLE = 0.35  # of that, where a dome is level to 1 degree
_DEPTH_SHARES = (0.08, 0.28)  # of the gel's height: deeper, no quick mesh has a known bias
_PLASTIC = 1.324717957244746


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """What the folder does not say."""

    truth: PlantTruth  # the emulated world
    force_n: FloatArray  # by press, without noise [N]


def write_folder(folder: Path, *, presses: int, seed: int) -> Written:
    """Press an emulated DIGIT at as many places, and write images and a table of the readings.

    The gel has relaxed, and the lab wetted it; the robot's axes are those of the sensor.
    """
    unit = emulated_unit(load_sensor(SENSOR))
    truth = replace(draw_truth(seed, unit=unit, friction=0.0), tilt_rad=(0.0, 0.0))
    random = np.random.default_rng([seed, 40])
    plants = {name: Plant(truth, tip) for name, tip in TOOLS.items()}
    (folder / "bilder").mkdir(parents=True)
    rest = np.mean([_frame(truth, TOOLS["Kugel 6mm"], 0.0, k) for k in range(_REST_FRAMES)], axis=0)
    cv2.imwrite(str(folder / "bilder" / "ruhe.png"), np.rint(rest).astype(np.uint8))
    reach = [_REACH * 0.5 * n * p for n, p in zip(unit.image_size, unit.pixel_m, strict=True)]
    clock, zero_n, forces, rows = datetime(2026, 11, 27, 9, 0), truth.force_offset_n[2], [], [_HEAD]
    for k in range(1, presses + 1):
        tool = list(TOOLS)[k % len(TOOLS)]
        tip, plant = TOOLS[tool], plants[tool]
        at = [(2.0 * (k / _PLASTIC**p % 1.0) - 1.0) * r for p, r in zip((1, 2), reach, strict=True)]
        if isinstance(tip, CylinderTip):  # the emulated gel is level under a face
            at = [_MIDDLE * each for each in at]
        place, tilt = (at[0], at[1]), (0.0, 0.0)
        if isinstance(tip, SphereTip):
            place, tilt = touched_at(place, unit, tip)
        low, high = _DEPTH_SHARES
        share = low + (high - low) * (k * math.sqrt(0.5) % 1.0)
        depth_m = share * unit.gel.thickness_m
        name = f"druck_{k:02d}.png"
        image = _frame(truth, tip, depth_m, 100 + k, place=place, tilt=tilt)
        cv2.imwrite(str(folder / "bilder" / name), image)
        forces.append(truth.young_pa * plant.table.at(depth_m)[0])
        for state, held_n, shown in (("ruhe", 0.0, "ruhe.png"), ("gedrückt", forces[-1], name)):
            clock += timedelta(seconds=float(random.uniform(4.0, 9.0)))
            reading = (held_n + zero_n + truth.force_noise_n * random.standard_normal()) / _GF
            depth = f"{depth_m * 1e3:.4f}" if held_n else ""
            cells = [f"{at[0] * 1e3:.3f}", f"{at[1] * 1e3:.3f}", depth, f"{reading:.2f}"]
            text = ";".join(cell.replace(".", ",") for cell in cells)
            rows.append(
                f"{k};{clock.isoformat(timespec='milliseconds')};{state};{shown};{tool};{text}"
            )
    (folder / "messung.csv").write_text("\n".join([*rows, ""]), encoding="utf-8")
    return Written(truth=truth, force_n=np.array(forces))


def _frame(
    truth: PlantTruth,
    tip: Tip,
    depth_m: float,
    noise_seed: int,
    *,
    place: tuple[float, float] = (0.0, 0.0),
    tilt: tuple[float, float] = (0.0, 0.0),
) -> np.ndarray:
    return render_press(
        truth, tip, depth_m, _SIZE, centre_m=place, tilt_rad=tilt, noise_seed=noise_seed
    )
