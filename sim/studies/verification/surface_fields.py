"""Pressure and shear on the surface against exact solutions, over the whole contact."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import matplotlib.tri
import numpy as np

from sim.contact.surface_and_grip import Grip
from sim.effects.effect_choice import plan_effects
from sim.effects.presets import build_model, regularised_indenter
from sim.fields.pressure_and_shear import surface_traction
from sim.fields.saved_press import top_surface
from sim.mesh.elements import quadratic_triangle_values
from sim.press_arguments import scene_from
from sim.scene.indenter import Sphere
from sim.scene.scene import ContactMode, Effect, Preset, Scene
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.studies import from_file
from sim.studies.verification import Row, exact, section
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.tables import Table

# What the L2 error over the contact may be, and what of a field may not be round, of its maximum.
ALLOWED = {Preset.BALANCED: 0.05, Preset.ACCURATE: 0.02}
ROUND_ALLOWED = {Preset.BALANCED: 0.03}
# Edges so many times longer give the order of convergence.
_COARSER = 2.0
# Beyond this share of a sharp rim's radius a field is singular.
_FINITE_SHARE = 0.9
_FRICTION = 0.5
_YOUNG_PA, _POISSON = 0.3e6, 0.49
_MODULUS_PA, _SHEAR_PA = _YOUNG_PA / (1.0 - _POISSON**2), 0.5 * _YOUNG_PA / (1.0 + _POISSON)
_RADII, _ANGLES = 80, 96


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampled:
    """A press and its fields on circles about the indenter's axis, shape [radius, angle, ...]."""

    force_n: FloatArray
    twist_rad: float
    indenter: dict[str, float]  # its radius and depth, as exact solutions take them
    layer: exact.BondedLayers
    contact_m: float
    radii_m: FloatArray
    pressure_pa: FloatArray
    along_pa: FloatArray  # t_tau along x
    around_pa: FloatArray  # t_tau around the axis

    @property
    def hertz(self) -> dict[str, float]:
        """The contact's radius [m] and largest pressure [Pa] that Hertz gives to the force."""
        force = float(self.force_n[2])
        contact = (0.75 * force * self.indenter["radius_m"] / _MODULUS_PA) ** (1.0 / 3.0)
        return {"contact_m": contact, "pressure_pa": 1.5 * force / (math.pi * contact**2)}

    @property
    def inside_m(self) -> FloatArray:
        """The radii up to where a field is finite under a sharp rim [m]."""
        return np.minimum(self.radii_m, _FINITE_SHARE * self.contact_m)

    @property
    def turn(self) -> dict[str, float]:
        """Friction, and 2 G times the turn [Pa]."""
        return {"friction": _FRICTION, "shear_strain_pa": 2.0 * _SHEAR_PA * self.twist_rad}


Compared = tuple[FloatArray, FloatArray]
"""A field, and its exact values."""


def _hertz(found: Sampled) -> Compared:
    """The pressure that Hertz gives to the same force."""
    share = np.minimum(found.radii_m / found.hertz["contact_m"], 1.0)
    return found.pressure_pa, found.hertz["pressure_pa"] * np.sqrt(1.0 - share**2)


def _carried(found: Sampled) -> Compared:
    """The mean over a circle: the solution leaves out what is not round, and across the way."""
    held = min(float(np.hypot(*found.force_n[:2]) / (_FRICTION * found.force_n[2])), 1.0)
    terms = {"friction": _FRICTION, "held": held, **found.hertz}
    shear = exact.carried_ball_shear(found.radii_m, **terms)
    return found.along_pa.mean(axis=1, keepdims=True), shear


def _turned_punch(found: Sampled) -> Compared:
    terms = {"force_n": float(found.force_n[2]), "radius_m": found.contact_m, **found.turn}
    return found.around_pa, exact.turned_punch_shear(found.inside_m, **terms)


_EXACT: dict[str, Callable[[Sampled], Compared]] = {
    "hertz": _hertz,
    "ball_layer": lambda f: (f.pressure_pa, f.layer.ball_pressure(f.radii_m, **f.indenter)),
    "punch_layer": lambda f: (f.pressure_pa, f.layer.punch_pressure(f.inside_m, **f.indenter)),
    "carried": _carried,
    "sliding": lambda f: (f.along_pa, _FRICTION * _hertz(f)[1]),
    "turned_ball": lambda f: (f.around_pa, exact.turned_ball_shear(f.radii_m, **f.turn, **f.hertz)),
    "turned_punch": _turned_punch,
}


class Case(NamedTuple):
    """A field with an exact solution."""

    name: str
    press: str  # the scene
    exact: str
    presets: Sequence[Preset] = tuple(ALLOWED)


PRESSURES, SHEARS = (
    [Case(**row) for row in from_file("verification/presses.toml")[name]]
    for name in ("pressure", "shear")
)


def measure_pressure(*, presets: tuple[Preset, ...] = tuple(ALLOWED)) -> Table:
    """Press what has an exact pressure."""
    return _measured(PRESSURES, presets, "pressures")


def measure_shear() -> Table:
    """Press and move what has an exact shear."""
    return _measured(SHEARS, tuple(ALLOWED), "shears")


def _measured(cases: Sequence[Case], presets: Sequence[Preset], prose: str) -> Table:
    """Press every case on its presets, and on a coarser mesh of the first one for the order."""
    rows, passed = list[Row](), True
    for case in cases:
        for preset in (each for each in presets if each in case.presets):
            scene = replace(scene_from(case.press), preset=preset)
            row, met = row_of(case, scene)
            if preset is presets[0]:
                coarse = _errors(case, replace(scene, refinement=1.0 / _COARSER))[0]
                row["order"] = math.log(coarse / (1e-2 * float(row["L2 error [%]"] or 0.0)), 2.0)
            rows.append({"field": case.name, "preset": preset.value, **row})
            passed &= met
    words = f"{cases[0].press} --preset {presets[0].value}"
    allowed = {"allowed": ALLOWED, "round_allowed": ROUND_ALLOWED}
    return section(prose, rows, passed=passed, press=words, **allowed)


def row_of(case: Case, scene: Scene) -> tuple[Row, bool]:
    """Return the errors of a case's field as a row, and whether they are allowed."""
    error, uneven = _errors(case, scene)
    allowed, limit = ALLOWED[scene.preset], ROUND_ALLOWED.get(scene.preset)
    met = error <= allowed and (uneven is None or limit is None or uneven <= limit)
    row: Row = {
        "L2 error [%]": 100.0 * error,
        "allowed [%]": 100.0 * allowed,
        "not round [% of the maximum]": None if uneven is None else 100.0 * uneven,
        "allowed": None if uneven is None or limit is None else 100.0 * limit,
        "order": None,
    }
    return row, met


def _errors(case: Case, scene: Scene) -> tuple[float, float | None]:
    """Return the L2 error of a case's field, and what of it is not round.

    Under a sharp rim both are judged up to where the field is finite. What is carried is not round.
    """
    is_sharp = not isinstance(scene.indenter, Sphere)
    found = sampled(scene, beyond=1.0 if is_sharp else 1.25)
    field, exact_pa = _EXACT[case.exact](found)
    inside = found.radii_m < (_FINITE_SHARE if is_sharp else 1.0) * found.contact_m
    error = error_relative(found.radii_m[inside], field[inside], exact_pa[inside, None])
    if any(scene.motion.shift_m):
        return error, None
    return error, asymmetry_relative(field[inside] if is_sharp else field)


def error_relative(radii_m: FloatArray, field: FloatArray, exact_field: FloatArray) -> float:
    """Return the L2 norm of the difference over that of the exact field, both on circles."""

    def size(values: FloatArray) -> float:
        return float(radii_m @ (values**2).sum(axis=1))

    whole = np.broadcast_to(exact_field, field.shape)
    return math.sqrt(size(field - whole) / size(whole))


def asymmetry_relative(field: FloatArray) -> float:
    """Return the largest deviation from the mean over a circle, over the largest value."""
    off = field - field.mean(axis=1, keepdims=True)
    return float(np.abs(off).max() / np.abs(field).max())


def sampled(scene: Scene, *, beyond: float) -> Sampled:
    """Press a scene and sample its pressure and shear, up to so many radii of the contact."""
    path, point = _pressed(scene)
    body, depth = scene.indenter, scene.target.depth_m or 0.0
    layer = exact.BondedLayers.of_scene(scene)
    contact = radius = exact.radius_m(scene)
    if isinstance(body, Sphere):
        contact = layer.ball_force(radius_m=radius, depth_m=depth)[1]
    radii = beyond * contact * (np.arange(_RADII) + 0.5) / _RADII
    angles = 2.0 * np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
    sample = on_circles(path.model, point, radii, angles)
    found = surface_traction(path.model, point)
    shear = sample(found.tangential_pa)
    return Sampled(
        force_n=point.force_n,
        twist_rad=scene.motion.twist_rad,
        indenter={"radius_m": radius, "depth_m": depth},
        layer=layer,
        contact_m=contact,
        radii_m=radii,
        pressure_pa=sample(found.pressure_pa),
        along_pa=shear[..., 0],
        around_pa=shear[..., 1] * np.cos(angles) - shear[..., 0] * np.sin(angles),
    )


def _pressed(scene: Scene) -> tuple[LoadingPath, PathPoint]:
    """Press a scene; one that grips is pressed without friction, as its solution is, then moved."""
    plan = plan_effects(scene)
    felt = regularised_indenter(scene)
    path, depth = LoadingPath(build_model(scene, plan=plan), felt), scene.target.depth_m or 0.0
    if scene.contact is not ContactMode.FRICTION:
        return path, path.advance(depth)
    smooth = replace(
        scene, contact=ContactMode.FRICTIONLESS, effects=((Effect.LOCKING_FREE_ELEMENT, True),)
    )
    free = build_model(smooth, plan=plan_effects(smooth), mesh=path.model.mesh)
    point = LoadingPath(free, felt).advance(depth)
    state, contact = point.state.copy(), point.equilibrium.contact
    state.grip = Grip(
        held=np.any(contact.forces != 0.0, axis=2).astype(np.int32),
        anchors=contact.points - state.tip,
        loads=-contact.forces / free.surface.areas[..., None],
    )
    path.advance(point.depth_m, start=replace(point, state=state))
    motion = scene.motion
    return path, path.carry(shift_m=motion.shift_m, twist_rad=motion.twist_rad)


def on_circles(
    model: Model, point: PathPoint, radii_m: FloatArray, angles_rad: FloatArray
) -> Callable[[FloatArray], FloatArray]:
    """Return what samples a nodal field of the model on circles about the indenter's tip."""
    top = top_surface(model)
    places = top.of(point.state.positions)[:, :2] - point.state.tip[:2]
    x, y = np.outer(radii_m, np.cos(angles_rad)), np.outer(radii_m, np.sin(angles_rad))
    corners = top.faces[:, :3]
    plan = matplotlib.tri.Triangulation(places[:, 0], places[:, 1], corners)
    face = np.asarray(plan.get_trifinder()(x, y)).reshape(-1)
    a, b, c = (places[corners[face, k]] for k in range(3))
    sides = np.stack([b - a, c - a], axis=2)
    along = np.linalg.solve(sides, (np.column_stack([x.ravel(), y.ravel()]) - a)[..., None])[..., 0]
    shares = np.column_stack([1.0 - along.sum(axis=1), along])
    if top.faces.shape[1] == 6:
        shares = quadratic_triangle_values(shares)

    def sample(nodal: FloatArray) -> FloatArray:
        whole = nodal[top.sources]
        if nodal.ndim == 2:
            whole = whole * top.signs
        values = np.einsum("sk,sk...->s...", shares, whole[top.faces[face]])
        return np.asarray(values.reshape(*x.shape, *nodal.shape[1:]))

    return sample
