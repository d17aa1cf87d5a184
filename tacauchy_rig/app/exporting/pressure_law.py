"""A sensor's law of pressure over depth, for simulators whose contact is compliant.

Such simulators let rigid bodies overlap and integrate a pressure p(d) over the overlap, d being how
deep a point of the gel lies in the body. A gel is no such foundation: neighbours move together. The
law c (d / H)^n is the one whose forces are nearest to those of finite elements under balls.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from sim.scene.pad import Pad
from sim.sensor.sensor import load_sensor
from tacauchy_rig.app.importing.text_tables import as_csv
from tacauchy_rig.app.sweep.plan import Design, Plan, Press, Simulation, rows_of
from tacauchy_rig.app.sweep.shards import compute_shard
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.store.atomic_write import write_atomically

_DIAMETERS_MM, _SHARES = (4, 6, 8, 12), np.linspace(0.05, 0.25, 6)
_TOLERANCE, _POINTS = 0.05, 400


def write_pressure_law(source: Path, out: Path) -> None:
    """Press balls into a sensor; write ``pressure-law.json`` and ``forces.csv``.

    Args:
        source: Name of a sensor, or its file.
    """
    sensor = load_sensor(str(source))
    pad = sensor.pad
    depths = [f"{1e3 * share * pad.height_m:.6f} mm" for share in _SHARES]
    balls = [f"sphere:diameter={size}mm" for size in _DIAMETERS_MM]
    press: dict[str, Any] = {"sensor": str(source), "indenter": balls, "depth": depths}
    simulation = Simulation(tolerance=_TOLERANCE, samples=1)
    plan = Plan(design=Design.GRID, press=Press(**press), simulation=simulation)
    rows = rows_of(plan)
    found, _took = compute_shard(rows, simulation)
    sizes = 1e-3 * np.repeat(_DIAMETERS_MM, len(_SHARES))
    forces, depth = found["wrench"][:, 2], found["depth_m"]
    overlaps = [_overlap(pad, *each) for each in zip(sizes, depth, strict=True)]
    power, linear = _law(overlaps, forces), _law(overlaps, forces, exponent=1.0)

    def ratios(law: tuple[float, float]) -> FloatArray:
        return np.array([law[0] * (d ** law[1]).sum() * area for d, area in overlaps]) / forces

    unseen = []  # of each ball by the law of the others
    for size in np.unique(sizes):
        others = np.flatnonzero(sizes != size)
        law = _law([overlaps[k] for k in others], forces[others])
        unseen.append(ratios(law)[sizes == size])
    share, origin = sensor.young_uncertainty()
    terms = {
        "shape_of_the_law": float(np.abs(np.log(np.concatenate(unseen))).max()),
        "simulated_forces": float(np.nanmax(found["force_error"])),
        "stiffness": 2.0 * float(np.log1p(share)),
    }
    within = terms["shape_of_the_law"] + np.hypot(terms["simulated_forces"], terms["stiffness"])
    stiffness = linear[0] / pad.height_m
    content = {
        "sensor": sensor.name,
        "law": "pressure = coefficient (depth / height)^exponent; depth of a point of the resting "
        "gel in the body, along z",
        "coefficient_pa": power[0],
        "exponent": power[1],
        "height_m": pad.height_m,
        "valid_to_depth_m": float(depth.max()),
        "factor_95": float(np.exp(within)),
        "factor_95_terms": terms,
        "stiffness_source": origin,
        "linear": {
            "pressure_over_depth_pa_m": stiffness,
            "factor_of_forces_most": float(np.exp(np.abs(np.log(ratios(linear))).max())),
        },
        "newton": {"ModelBuilder.ShapeConfig": {"is_hydroelastic": True, "kh": stiffness}},
        "drake": {"hydroelastic_modulus_pa": linear[0], "slab_thickness_m": pad.height_m},
        "mujoco": "no pressure law: apply forces.csv as xfrc_applied, or use tacauchy_rig.envs",
    }
    write_atomically(out / "pressure-law.json", (json.dumps(content, indent=2) + "\n").encode())
    columns = (depth, forces, found["force_error"], forces * ratios(power))
    numbers = zip(*(each.tolist() for each in columns), strict=True)
    head = ("indenter", "depth_m", "force_n", "stated_error", "force_of_the_law_n")
    lines = [(row.indenter, *each) for row, each in zip(rows, numbers, strict=True)]
    write_atomically(out / "forces.csv", as_csv([head, *lines]))


def _overlap(pad: Pad, diameter_m: float, depth_m: float) -> tuple[FloatArray, float]:
    """Return depths over the height where a ball overlaps the resting gel, and a point's area."""
    half = np.sqrt(max(diameter_m * depth_m, 0.0))
    x, y = np.meshgrid(*[np.linspace(-half, half, _POINTS)] * 2)
    radius = 0.5 * diameter_m
    ball = radius - np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0.0))
    depth = pad.height_at(x, y) - (pad.height_m - depth_m + ball)
    inside = depth > 0.0
    return depth[inside] / pad.height_m, float((2.0 * half / (_POINTS - 1)) ** 2)


def _law(
    overlaps: list[tuple[FloatArray, float]], forces: FloatArray, exponent: float | None = None
) -> tuple[float, float]:
    """Return coefficient [Pa] and exponent of the law whose forces are off least, relatively."""

    def fitted(n: float) -> FloatArray:
        told = np.array([(depth**n).sum() * area for depth, area in overlaps])
        return np.asarray(np.log(forces / told))

    if exponent is None:
        bounds = (0.1, 3.0)
        exponent = minimize_scalar(lambda n: np.var(fitted(n)), bounds=bounds, method="bounded").x
    return float(np.exp(fitted(exponent).mean())), float(exponent)
