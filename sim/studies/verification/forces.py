"""F_z against exact solutions, axisymmetric ones, finer meshes and one real press."""

from __future__ import annotations

import csv
import logging
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import resources

import numpy as np

from sim.effects.coarse import coarse_press
from sim.effects.plan import plan_effects
from sim.effects.presets import RESOLUTIONS, build_model, mesh_for
from sim.effects.scene_path import path_for
from sim.error.estimate import estimated
from sim.press import press
from sim.press_command import scene_from
from sim.scene.indenter import Cylinder, Indenter, Sphere, describe
from sim.scene.material import LawName, Material
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Preset, Scene
from sim.sensor.sensor import load_sensor
from sim.solve.loading_path import LoadingPath
from sim.studies.verification import stated
from sim.studies.verification.exact import BondedLayers, Ply, hertz_force
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.tables import Cell, Table, table_of_rows

_YOUNG_PA = 0.3e6
_PUNCH_RADIUS_M, _PUNCH_PAD_M, _PUNCH_DEPTH_M = 2.5e-3, 4.5e-3, 0.05e-3
_PUNCH = "--pad disc:radius=22.5mm,height=4.5mm --indenter cylinder:diameter=5mm --depth 0.05mm"
# Poisson's ratio, and by how much the force may be off.
PUNCH_ALLOWED = ((0.45, 0.015), (0.47, 0.015), (0.49, 0.015), (0.499, 0.03))

_BALL_RADIUS_M, _BALL_POISSON = 1e-3, 0.48
_BALL_ALLOWED = 0.015
# Below this contact radius over thickness the layer is a half space, and Hertz is to be met.
_THICK_SHARE = 0.01
# Thickness and depth [m].
BALL_PRESSES = ((15e-3, 10e-6), (15e-3, 20e-6), (4e-3, 40e-6), (2e-3, 40e-6))


def measure_punch(
    *, preset: Preset = Preset.ACCURATE, allowed: tuple[tuple[float, float], ...] = PUNCH_ALLOWED
) -> Table:
    """Press a flat punch at every Poisson's ratio."""
    rows: list[dict[str, Cell]] = []
    passed = True
    presses = [_words(_PUNCH, poisson, preset) for poisson, _ in allowed]
    for words, (poisson, limit) in zip(presses, allowed, strict=True):
        layer = BondedLayers([Ply(_YOUNG_PA, poisson, _PUNCH_PAD_M)])
        expected = layer.punch_force(radius_m=_PUNCH_RADIUS_M, depth_m=_PUNCH_DEPTH_M)
        force = press(scene_from(words)).force_n[2]
        error = force / expected - 1.0
        passed &= abs(error) <= limit
        rows.append(
            {
                "nu": poisson,
                "kappa": layer.punch_factor(_PUNCH_RADIUS_M),
                "F_z [N]": force,
                "exact [N]": expected,
                "error [%]": 100.0 * error,
                "allowed [%]": 100.0 * limit,
            }
        )
    return table_of_rows(
        rows,
        passed=passed,
        command=f"tacauchy-rig press {presses[0]}",
        **stated("punch", preset=preset),
    )


def measure_ball(
    *, preset: Preset = Preset.ACCURATE, presses: tuple[tuple[float, float], ...] = BALL_PRESSES
) -> Table:
    """Press a ball into pads of different thickness."""
    rows: list[dict[str, Cell]] = []
    passed = True
    terms = {"radius_m": _BALL_RADIUS_M, "young_pa": _YOUNG_PA, "poisson": _BALL_POISSON}
    for height, depth in presses:
        force = press(scene_from(_ball(height, depth, preset))).force_n[2]
        hertz = hertz_force(depth_m=depth, **terms)
        layers = BondedLayers([Ply(_YOUNG_PA, _BALL_POISSON, height)])
        layer, contact = layers.ball_force(radius_m=terms["radius_m"], depth_m=depth)
        expected = hertz if contact < _THICK_SHARE * height else layer
        passed &= abs(force / expected - 1.0) <= _BALL_ALLOWED
        rows.append(
            {
                "pad [mm]": height * 1e3,
                "depth [mm]": depth * 1e3,
                "a / h": contact / height,
                "F_z [N]": force,
                "Hertz [N]": hertz,
                "off Hertz [%]": 100.0 * (force / hertz - 1.0),
                "layer [N]": layer,
                "off the layer [%]": 100.0 * (force / layer - 1.0),
            }
        )
    return table_of_rows(
        rows,
        passed=passed,
        command=f"tacauchy-rig press {_ball(*presses[0], preset)}",
        **stated("ball", preset=preset),
    )


def _ball(height_m: float, depth_m: float, preset: Preset) -> str:
    pad = f"--pad disc:radius=15mm,height={height_m * 1e3:g}mm"
    stated = f"{pad} --indenter sphere:diameter=2mm --depth {depth_m * 1e3:g}mm"
    return _words(stated, _BALL_POISSON, preset)


def _words(stated: str, poisson: float, preset: Preset) -> str:
    """Return a press as the command line takes it."""
    gel = f"--young {_YOUNG_PA * 1e-6:g}MPa --poisson {poisson:g} --law linear"
    return f"{stated} {gel} --preset {preset.value}"


_DISC_ALLOWED = 0.01
_DISC_FILE = "disc_press_nu045.csv"


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscForce:
    """One force of the reference, with how far its finest mesh is from it."""

    law: LawName
    depth_m: float
    force_n: float
    uncertainty_n: float


def measure_disc(*, preset: Preset = Preset.ACCURATE, depth_max_m: float = 0.5e-3) -> Table:
    """Press both laws through the reference's depths, each along one path."""
    rows: list[dict[str, Cell]] = []
    worst, words = 0.0, ""
    for law in (LawName.NEO_HOOKEAN, LawName.STABLE_NEO_HOOKEAN):
        wanted = [f for f in disc_forces() if f.law is law and f.depth_m <= depth_max_m]
        words = disc_press(law, wanted[-1].depth_m, preset)
        scene = scene_from(words)
        path = path_for(scene, plan_effects(scene))
        for reference in wanted:
            force = float(path.advance(reference.depth_m).force_n[2])
            error = force / reference.force_n - 1.0
            doubt = reference.uncertainty_n / reference.force_n
            worst = max(worst, abs(error))
            rows.append(
                {
                    "law": law.value,
                    "depth [mm]": round(reference.depth_m * 1e3, 6),
                    "F_z [N]": force,
                    "reference [N]": reference.force_n,
                    "error [%]": 100 * error,
                    "reference's own doubt [%]": 100 * doubt,
                }
            )
    return table_of_rows(
        rows,
        passed=worst <= _DISC_ALLOWED,
        command=f"tacauchy-rig press {words}",
        **stated("disc", preset=preset),
    )


def disc_forces() -> tuple[DiscForce, ...]:
    """Return the reference's forces, rising in depth for each law."""
    text = resources.files("sim.studies.verification.data").joinpath(_DISC_FILE).read_text("utf-8")
    lines = (line for line in text.splitlines() if not line.startswith("#"))
    return tuple(
        DiscForce(
            law=LawName(row["law"]),
            depth_m=float(row["depth_mm"]) * 1e-3,
            force_n=float(row["force_n"]),
            uncertainty_n=float(row["uncertainty_n"]),
        )
        for row in csv.DictReader(lines)
    )


def disc_press(law: LawName, depth_m: float, preset: Preset) -> str:
    """Return the reference's press as the command line takes it."""
    return (
        "--pad disc:radius=12mm,height=4.5mm --indenter cylinder:diameter=5mm "
        f"--depth {depth_m * 1e3:g}mm --young 0.3MPa --poisson 0.45 --law {law.value} "
        f"--contact bonded --preset {preset.value}"
    )


_PRESS_FILE = "real_press.toml"
_FIT_ALLOWED = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class RealPress:
    """A press that somebody measured, as the command line takes it."""

    source: str
    press: str
    force_n: float


def measure_real(*, preset: Preset = Preset.ACCURATE) -> Table:
    """Fit E, press anew with it, and show what the fit hangs on."""
    real = real_press()
    numbers = load_sensor(scene_from(real.press).sensor).numbers
    young, poisson = numbers["material.young"], numbers["material.poisson"]
    asked = (
        (poisson.value, ContactMode.FRICTIONLESS),
        (poisson.value, ContactMode.BONDED),
        (poisson.value - poisson.uncertainty, ContactMode.FRICTIONLESS),
        (poisson.value + poisson.uncertainty, ContactMode.FRICTIONLESS),
    )
    fits = [fitted_young(real, nu, contact, preset) for nu, contact in asked]
    words = real_words(real, fits[0], *asked[0], preset)
    force = press(scene_from(words)).force_n[2]
    forces = (force, None, None, None)
    return Table(
        **stated(
            "real",
            preset=preset,
            real=real,
            scene=scene_from(real.press),
            fit=fits[0],
            young=young,
        ),
        columns=("nu", "contact", "fitted E [MPa]", "F_z pressed anew [N]", "measured [N]"),
        rows=tuple(
            (nu, contact.value, fit * 1e-6, again, real.force_n)
            for (nu, contact), fit, again in zip(asked, fits, forces, strict=True)
        ),
        passed=abs(force / real.force_n - 1.0) <= _FIT_ALLOWED,
        command=f"tacauchy-rig press {words}",
    )


def real_press() -> RealPress:
    """Return the measured press."""
    text = resources.files("sim.studies.verification.data").joinpath(_PRESS_FILE).read_text("utf-8")
    data = tomllib.loads(text)
    return RealPress(source=data["source"], press=data["press"], force_n=data["force_n"])


def fitted_young(real: RealPress, poisson: float, contact: ContactMode, preset: Preset) -> float:
    """Return the E [Pa] at which a press gives the measured force, to which it is proportional."""
    young = scene_from(real.press).material.young_pa
    scene = scene_from(real_words(real, young, poisson, contact, preset))
    return young * real.force_n / press(scene).force_n[2]


def real_words(
    real: RealPress, young_pa: float, poisson: float, contact: ContactMode, preset: Preset
) -> str:
    """Return the measured press with another gel, contact and preset."""
    gel = f"--young {young_pa * 1e-6:.10g}MPa --poisson {poisson:g}"
    return f"{real.press} {gel} --contact {contact.value} --preset {preset.value}"


# Coarser than 1, two edges and less lie under the ball, and F_z is not yet on any power of h.
REFINEMENTS = (1.0, 1.5, 2.0)
# What is pressed, and the least order that is asked.
_INDENTERS: tuple[tuple[Indenter, float], ...] = (
    (Cylinder(diameter_m=4e-3), 0.9),
    (Sphere(diameter_m=8e-3), 1.8),
)
_SCENE = scene_from(
    "--pad disc:radius=8mm,height=4mm --young 0.4MPa --poisson 0.48 "
    "--indenter cylinder:diameter=4mm --depth 0.1mm --effect finite-strain=on --preset fast"
)

_RIM = replace(_SCENE, material=Material(young_pa=2e5, poisson=0.47), preset=Preset.BALANCED)
# Edges at the rim in radii of the punch, and where their order has to lie.
EDGE_SHARES = (0.16, 0.08, 0.04, 0.02)
_LOWEST, _HIGHEST = 0.75, 1.5
_SECTORS = 40


def fitted_order(edges: FloatArray, forces_n: FloatArray) -> tuple[float, float]:
    """Return p and the limit of F = limit + C h^p, least squares weighted by 1 / h.

    Args:
        edges: Edge lengths h in any unit, at least three.
        forces_n: F_z on each mesh [N].
    """
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
    rows: list[dict[str, Cell]] = []
    passed = True
    for indenter, wanted in _INDENTERS:
        scene = replace(_SCENE, indenter=indenter)
        plan = plan_effects(scene)
        forces = [
            float(coarse_press(scene, plan, factor).outputs.force_n[2]) for factor in REFINEMENTS
        ]
        headings = [f"F_z, edges 1/{factor:g} [N]" for factor in REFINEMENTS]
        row = _fitted_row(indenter, 1.0 / np.array(REFINEMENTS), forces, headings)
        rows.append(row | {"at least": wanted})
        passed &= float(row["order"] or 0.0) >= wanted
    return table_of_rows(rows, passed=passed, **stated("convergence"))


def _fitted_row(
    indenter: Indenter, edges: FloatArray, forces_n: Sequence[float], headings: Sequence[str]
) -> dict[str, Cell]:
    order, limit = fitted_order(edges, np.array(forces_n))
    forces = zip(headings, forces_n, strict=True)
    return {"indenter": describe(indenter), **dict(forces), "limit [N]": limit, "order": order}


def rim_forces(shares: Sequence[float] = EDGE_SHARES) -> tuple[float, ...]:
    """Return F_z with edges at the rim of so many radii, all else as preset balanced has it [N]."""
    plan = plan_effects(_RIM)
    forces = []
    for share in shares:
        resolution = replace(RESOLUTIONS[_RIM.preset], edge_share=share, sector_count=_SECTORS)
        mesh = mesh_for(_RIM, resolution=resolution)
        path = LoadingPath(build_model(_RIM, plan=plan, mesh=mesh), _RIM.indenter)
        point = path.advance(0.1e-3)
        forces.append(float(mesh.symmetry.whole_force(point.force_n)[2]))
    return tuple(forces)


def measure_rim() -> Table:
    """Fit the order to a sharp punch on four meshes."""
    headings = [f"F_z, edges of {share:g} radii [N]" for share in EDGE_SHARES]
    row = _fitted_row(_RIM.indenter, np.array(EDGE_SHARES), rim_forces(), headings)
    return table_of_rows(
        [row],
        passed=_LOWEST <= float(row["order"] or 0.0) <= _HIGHEST,
        **stated("rim", lowest=_LOWEST, highest=_HIGHEST),
    )


logger = logging.getLogger(__name__)

_INSIDE_WANTED = 0.9
_FINER = 2.0
_SCENES_FILE = "held_out.toml"
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


def measure_estimates() -> Table:
    """Press every scene that was held out on four meshes; ten take minutes."""
    return judged_estimates([refined_press(name, scene) for name, scene in HELD_OUT.items()])


def judged_estimates(rows: Sequence[dict[str, Cell]]) -> Table:
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
    text = (
        resources.files("sim.studies.verification.data").joinpath(_SCENES_FILE).read_text("utf-8")
    )
    for name, given in tomllib.loads(text).items():
        scene = scene_from(given["press"])
        if "dome_radii_m" in given and isinstance(scene.pad, BoxPad):
            x_m, y_m = given["dome_radii_m"]
            pad = replace(scene.pad, dome_radius_x_m=x_m, dome_radius_y_m=y_m)
            scene = replace(scene, pad=pad)
        yield name, scene


HELD_OUT = dict(_held_out())
