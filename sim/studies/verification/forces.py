"""F_z against exact solutions, axisymmetric ones, finer meshes and one real press."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import resources
from typing import Any

import numpy as np

from sim.effects.effect_choice import plan_effects
from sim.effects.press_with_effects import coarse_press, path_for
from sim.press import press
from sim.press_arguments import scene_from
from sim.scene.indenter import Cylinder, Sphere, describe
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Preset
from sim.sensor.sensor import load_sensor
from sim.studies import from_file
from sim.studies.verification import Row, section
from sim.studies.verification.exact import BondedLayers, hertz_force, radius_m
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.tables import Table

# Below this contact radius over thickness the layer is a half space, and Hertz is to be met.
_THICK_SHARE = 0.01
_STATED = from_file("verification/presses.toml")


def measure_punch(
    *, preset: Preset = Preset.ACCURATE, stated: Sequence[Mapping[str, Any]] = _STATED["punch"]
) -> Table:
    """Press a flat punch at every Poisson's ratio."""
    rows, passed = list[Row](), True
    for each in stated:
        scene = replace(scene_from(each["press"]), preset=preset)
        layer, radius = BondedLayers.of_scene(scene), radius_m(scene)
        force, depth = press(scene).force_n[2], scene.target.depth_m or 0.0
        expected = layer.punch_force(radius_m=radius, depth_m=depth)
        passed &= abs(force / expected - 1.0) <= each["allowed"]
        rows.append(
            {
                "nu": scene.material.poisson,
                "kappa": layer.punch_factor(radius),
                "F_z [N]": force,
                "exact [N]": expected,
                "error [%]": 100.0 * (force / expected - 1.0),
                "allowed [%]": 100.0 * each["allowed"],
            }
        )
    words = f"{stated[0]['press']} --preset {preset.value}"
    return section("punch", rows, passed=passed, press=words, preset=preset)


def measure_ball(
    *, preset: Preset = Preset.ACCURATE, stated: Sequence[Mapping[str, Any]] = _STATED["ball"]
) -> Table:
    """Press a ball into pads of different thickness."""
    rows, passed = list[Row](), True
    for each in stated:
        scene = replace(scene_from(each["press"]), preset=preset)
        gel, height, force = scene.material, scene.pad.height_m, press(scene).force_n[2]
        terms = {"radius_m": radius_m(scene), "depth_m": scene.target.depth_m or 0.0}
        hertz = hertz_force(young_pa=gel.young_pa, poisson=gel.poisson, **terms)
        layer, contact = BondedLayers.of_scene(scene).ball_force(**terms)
        expected = hertz if contact < _THICK_SHARE * height else layer
        passed &= abs(force / expected - 1.0) <= each["allowed"]
        rows.append(
            {
                "pad [mm]": height * 1e3,
                "depth [mm]": terms["depth_m"] * 1e3,
                "a / h": contact / height,
                "F_z [N]": force,
                "Hertz [N]": hertz,
                "off Hertz [%]": 100.0 * (force / hertz - 1.0),
                "layer [N]": layer,
                "off the layer [%]": 100.0 * (force / layer - 1.0),
            }
        )
    words = f"{stated[0]['press']} --preset {preset.value}"
    return section("ball", rows, passed=passed, press=words, preset=preset)


# --- A bonded punch on a clamped disc at finite strain, against axisymmetric solutions.
_DISC_ALLOWED = 0.01


def disc_forces() -> list[dict[str, str]]:
    """Return the reference's rows, rising in depth for each law, its own doubt in each."""
    file = resources.files("sim.studies.verification.data") / "disc_press_nu045.csv"
    lines = file.read_text("utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def measure_disc(*, preset: Preset = Preset.ACCURATE, depth_max_m: float = 0.5e-3) -> Table:
    """Press both laws through the reference's depths, each along one path."""
    rows, worst, words = list[Row](), 0.0, ""
    for law in (LawName.NEO_HOOKEAN, LawName.STABLE_NEO_HOOKEAN):
        wanted = [
            {name: float(row[name]) for name in ("depth_mm", "force_n", "uncertainty_n")}
            for row in disc_forces()
            if row["law"] == law and float(row["depth_mm"]) * 1e-3 <= depth_max_m
        ]
        depth = f"--depth {wanted[-1]['depth_mm']:g}mm"
        words = f"{_STATED['disc']} {depth} --law {law.value} --preset {preset.value}"
        scene = scene_from(words)
        path = path_for(scene, plan_effects(scene))
        for known in wanted:
            force = float(path.advance(known["depth_mm"] * 1e-3).force_n[2])
            error = force / known["force_n"] - 1.0
            worst = max(worst, abs(error))
            rows.append(
                {
                    "law": law.value,
                    "depth [mm]": known["depth_mm"],
                    "F_z [N]": force,
                    "reference [N]": known["force_n"],
                    "error [%]": 100.0 * error,
                    "reference's own doubt [%]": 100.0 * known["uncertainty_n"] / known["force_n"],
                }
            )
    return section("disc", rows, passed=worst <= _DISC_ALLOWED, press=words, preset=preset)


# --- Young's modulus from one press of a real GelSight Mini gel.
_FIT_ALLOWED = 1e-3
# Its source, its words, and the force that somebody measured [N].
REAL = from_file("verification/data/real_press.toml")


def real_words(young_pa: float, nu: float, contact: ContactMode, preset: Preset) -> str:
    """Return that press with another gel, contact and preset."""
    gel = f"--young {young_pa * 1e-6:.10g}MPa --poisson {nu:g}"
    return f"{REAL['press']} {gel} --contact {contact.value} --preset {preset.value}"


def fitted_young(nu: float, contact: ContactMode, preset: Preset) -> float:
    """Return the E [Pa] that gives the measured force, to which it is proportional."""
    young = scene_from(REAL["press"]).material.young_pa
    force = press(scene_from(real_words(young, nu, contact, preset))).force_n[2]
    return float(young * REAL["force_n"] / force)


def measure_real(*, preset: Preset = Preset.ACCURATE) -> Table:
    """Fit E, press anew with it, and show what the fit hangs on."""
    scene = scene_from(REAL["press"])
    numbers = load_sensor(scene.sensor).numbers
    young, poisson = numbers["material.young"], numbers["material.poisson"]
    ratios = (poisson.value, *(poisson.value + s * poisson.uncertainty for s in (-1.0, 1.0)))
    asked = [(nu, ContactMode.FRICTIONLESS) for nu in ratios]
    asked.insert(1, (poisson.value, ContactMode.BONDED))
    fits = [fitted_young(nu, contact, preset) for nu, contact in asked]
    words = real_words(fits[0], *asked[0], preset)
    again = press(scene_from(words)).force_n[2]
    rows: list[Row] = [
        {
            "nu": nu,
            "contact": contact.value,
            "fitted E [MPa]": fit * 1e-6,
            "F_z pressed anew [N]": again if number == 0 else None,
            "measured [N]": REAL["force_n"],
        }
        for number, ((nu, contact), fit) in enumerate(zip(asked, fits, strict=True))
    ]
    facts = {"preset": preset, "real": REAL, "scene": scene, "fit": fits[0], "young": young}
    passed = abs(again / REAL["force_n"] - 1.0) <= _FIT_ALLOWED
    return section("real", rows, passed=passed, press=words, **facts)


# --- How fast F_z converges as every edge gets shorter.
# Coarser than 1, two edges and less lie under the ball, and F_z is not yet on any power of h.
REFINEMENTS = (1.0, 1.5, 2.0)
# What is pressed, and the least order that is asked.
_INDENTERS = ((Cylinder(diameter_m=4e-3), 0.9), (Sphere(diameter_m=8e-3), 1.8))
_SCENE = scene_from(
    "--pad disc:radius=8mm,height=4mm --young 0.4MPa --poisson 0.48 "
    "--indenter cylinder:diameter=4mm --depth 0.1mm --effect finite-strain=on --preset fast"
)


def fitted_order(edges: FloatArray, forces_n: FloatArray) -> tuple[float, float]:
    """Return p and the limit of F = limit + C h^p of three or more, least squares over h."""
    weight = 1.0 / edges
    best = (np.inf, 0.0, 0.0)
    for order in np.arange(0.2, 6.0, 0.01):
        columns = np.column_stack([np.ones_like(edges), edges**order])
        solution = np.linalg.lstsq(columns * weight[:, None], forces_n * weight, rcond=None)[0]
        misfit = float(np.linalg.norm((columns @ solution - forces_n) * weight))
        best = min(best, (misfit, float(order), float(solution[0])))
    return best[1], best[2]


def measure_orders() -> Table:
    """Press a sharp punch and a ball on three meshes each."""
    rows, passed = list[Row](), True
    for indenter, wanted in _INDENTERS:
        scene = replace(_SCENE, indenter=indenter)
        pressed = partial(coarse_press, scene, plan_effects(scene))
        forces = [float(pressed(factor).outputs.force_n[2]) for factor in REFINEMENTS]
        order, limit = fitted_order(1.0 / np.array(REFINEMENTS), np.array(forces))
        named = zip(REFINEMENTS, forces, strict=True)
        rows.append(
            {
                "indenter": describe(indenter),
                **{f"F_z, edges 1/{factor:g} [N]": force for factor, force in named},
                "limit [N]": limit,
                "order": order,
                "at least": wanted,
            }
        )
        passed &= order >= wanted
    return section("convergence", rows, passed=passed)
