"""Pressure and shear on the surface against exact solutions, over the whole contact."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import matplotlib.tri
import numpy as np

from sim.contact.state import Grip
from sim.effects.plan import plan_effects
from sim.effects.presets import build_model, regularised_indenter
from sim.fields.contact_traction import surface_traction
from sim.fields.press_fields import top_surface
from sim.mesh.elements import quadratic_triangle_values
from sim.press_command import scene_from
from sim.scene.scene import ContactMode, Effect, Preset, Scene
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from sim.studies.verification import Row, exact, section
from sim.studies.verification.exact import BondedLayers, Ply
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
_GEL = f"--young {_YOUNG_PA * 1e-6:g}MPa --poisson {_POISSON} --law linear"
_DEEP = f"--pad disc:radius=15mm,height=10mm {_GEL}"
_GRIPS = (
    f"--contact friction:{_FRICTION} --effect friction=on --effect locking-free-element=on"
    " --output shear"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampled:
    """A press as its field is compared.

    Attributes:
        pressure: p [Pa] on circles about the indenter's axis.
        shear: t_tau [Pa], away from the axis, around it and upwards.
        along: t_tau along x [Pa].
    """

    scene: Scene
    point: PathPoint
    force_n: FloatArray
    contact_m: float
    pressure: RoundField
    shear: RoundField
    along: RoundField


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A field with an exact solution.

    Attributes:
        words: The scene.
        contact_m: Radius of the contact [m].
        compared: The field that is compared, and its exact values on the circles.
        within: Share of that radius up to which it is.
        is_round: Symmetry about the axis is judged.
        starts_free: Pressed without friction, as the solution is, which acts only from then on.
        presets: Those that it is judged on.
    """

    name: str
    words: str
    contact_m: Callable[[Scene], float]
    compared: Callable[[Sampled], tuple[RoundField, FloatArray]]
    within: float = 1.0
    is_round: bool = True
    starts_free: bool = False
    presets: tuple[Preset, ...] = tuple(ALLOWED)


def _layer(scene: Scene) -> BondedLayers:
    return BondedLayers([Ply(_YOUNG_PA, _POISSON, scene.pad.height_m)])


def _depth(scene: Scene) -> float:
    return scene.target.depth_m or 0.0


def _radius(scene: Scene) -> float:
    return float(getattr(scene.indenter, "radius_m"))  # noqa: B009 - cylinders and balls have one


def _ball_contact(scene: Scene) -> float:
    return _layer(scene).ball_force(radius_m=_radius(scene), depth_m=_depth(scene))[1]


def _hertz(found: Sampled) -> tuple[RoundField, FloatArray]:
    """The pressure that Hertz gives to the same force."""
    contact, peak = _hertz_terms(found)
    share = np.minimum(found.pressure.radii_m / contact, 1.0)
    return found.pressure, peak * np.sqrt(1.0 - share**2)


def _hertz_terms(found: Sampled) -> tuple[float, float]:
    """Return the contact's radius [m] and the largest pressure [Pa] that Hertz gives to a force."""
    force = float(found.force_n[2])
    contact = (0.75 * force * _radius(found.scene) / _MODULUS_PA) ** (1.0 / 3.0)
    return contact, 1.5 * force / (math.pi * contact**2)


def _ball_layer(found: Sampled) -> tuple[RoundField, FloatArray]:
    terms = {"radius_m": _radius(found.scene), "depth_m": _depth(found.scene)}
    return found.pressure, _layer(found.scene).ball_pressure(found.pressure.radii_m, **terms)


def _punch_layer(found: Sampled) -> tuple[RoundField, FloatArray]:
    radii, terms = found.pressure.radii_m, {"radius_m": _radius(found.scene)}
    inside = np.minimum(radii, _FINITE_SHARE * _radius(found.scene))
    layer = _layer(found.scene)
    return found.pressure, layer.punch_pressure(inside, depth_m=_depth(found.scene), **terms)


def _carried(found: Sampled) -> tuple[RoundField, FloatArray]:
    """The mean over a circle: the solution leaves out what is not round, and across the way."""
    held = min(float(np.hypot(*found.force_n[:2]) / (_FRICTION * found.force_n[2])), 1.0)
    contact, peak = _hertz_terms(found)
    shear = exact.carried_ball_shear(
        found.along.radii_m, friction=_FRICTION, pressure_pa=peak, contact_m=contact, held=held
    )
    return replace(found.along, values=found.along.round[:, None]), shear


def _sliding(found: Sampled) -> tuple[RoundField, FloatArray]:
    return found.along, _FRICTION * _hertz(found)[1]


def _around(found: Sampled) -> RoundField:
    return replace(found.shear, values=found.shear.values[..., 1])


def _turned_ball(found: Sampled) -> tuple[RoundField, FloatArray]:
    contact, peak = _hertz_terms(found)
    shear = exact.turned_ball_shear(
        found.shear.radii_m,
        friction=_FRICTION,
        pressure_pa=peak,
        contact_m=contact,
        shear_strain_pa=2.0 * _SHEAR_PA * found.scene.motion.twist_rad,
    )
    return _around(found), shear


def _turned_punch(found: Sampled) -> tuple[RoundField, FloatArray]:
    shear = exact.turned_punch_shear(
        np.minimum(found.shear.radii_m, _FINITE_SHARE * found.contact_m),
        friction=_FRICTION,
        force_n=float(found.force_n[2]),
        radius_m=found.contact_m,
        shear_strain_pa=2.0 * _SHEAR_PA * found.scene.motion.twist_rad,
    )
    return _around(found), shear


_BALL = "--indenter sphere:diameter=32mm --depth 0.1mm"
CASES = (
    Case(
        name="p, ball on a half space (Hertz)",
        words=f"{_DEEP} --indenter sphere:diameter=16mm --depth 0.05mm",
        contact_m=_ball_contact,
        compared=_hertz,
    ),
    Case(
        name="p, ball on a bonded layer",
        words=f"--pad disc:radius=15mm,height=3mm {_GEL} --indenter sphere:diameter=64mm "
        "--depth 0.05mm",
        contact_m=_ball_contact,
        compared=_ball_layer,
    ),
    Case(
        name="p, flat punch on a bonded layer",
        words=f"--pad disc:radius=15mm,height=4.5mm {_GEL} --indenter cylinder:diameter=5mm "
        "--depth 0.05mm",
        contact_m=_radius,
        compared=_punch_layer,
        within=_FINITE_SHARE,
    ),
    Case(
        name="t_tau, ball carried, slip in part (Cattaneo, Mindlin)",
        words=f"{_DEEP} {_BALL} {_GRIPS} --shift 0.06mm",
        contact_m=_ball_contact,
        compared=_carried,
        is_round=False,
        starts_free=True,
    ),
    Case(
        name="t_tau, ball carried, slip all over",
        words=f"{_DEEP} --indenter sphere:diameter=96mm --depth 0.0333mm {_GRIPS} --shift 0.1mm",
        contact_m=_ball_contact,
        compared=_sliding,
        is_round=False,
        starts_free=True,
    ),
    Case(
        name="t_tau, ball turned, slip in part (Lubkin)",
        words=f"{_DEEP} {_BALL} {_GRIPS} --twist 2.8deg",
        contact_m=_ball_contact,
        compared=_turned_ball,
        starts_free=True,
    ),
    Case(
        name="t_tau, flat punch turned, slip in part (Reissner, Sagoci)",
        words=f"{_DEEP} --indenter cylinder:diameter=2.5mm --depth 0.05mm {_GRIPS} --twist 1.79deg",
        contact_m=_radius,
        compared=_turned_punch,
        within=_FINITE_SHARE,
        starts_free=True,
        # A whole turn of preset accurate's mesh takes longer than all the others together.
        presets=(Preset.BALANCED,),
    ),
)


def measure_pressure(*, presets: tuple[Preset, ...] = tuple(ALLOWED)) -> Table:
    """Press what has an exact pressure."""
    return _measured([case for case in CASES if not case.starts_free], presets, "pressures")


def measure_shear() -> Table:
    """Press and move what has an exact shear."""
    return _measured([case for case in CASES if case.starts_free], tuple(ALLOWED), "shears")


def _measured(cases: Sequence[Case], presets: Sequence[Preset], prose: str) -> Table:
    """Press every case on its presets, and on a coarser mesh of the first one for the order."""
    rows, passed = list[Row](), True
    for case in cases:
        for preset in (each for each in case.presets if each in presets):
            scene = replace(scene_from(case.words), preset=preset)
            row, met = row_of(case, scene)
            if preset is presets[0]:
                coarse = _errors(case, replace(scene, refinement=1.0 / _COARSER))[0]
                row["order"] = math.log(coarse / (1e-2 * float(row["L2 error [%]"] or 0.0)), 2.0)
            rows.append({"field": case.name, "preset": preset.value, **row})
            passed &= met
    words = f"{cases[0].words} --preset {presets[0].value}"
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
    """Return the L2 error of a case's field, and what of it is not round."""
    found = sampled(case, scene)
    field, exact = case.compared(found)
    error = field.error_relative(exact[:, None], within_m=case.within * found.contact_m)
    judged_m = case.within * found.contact_m if case.within < 1.0 else math.inf
    return error, field.asymmetry_relative(within_m=judged_m) if case.is_round else None


def sampled(case: Case, scene: Scene) -> Sampled:
    """Press a case and sample its pressure and shear."""
    path, point = _pressed(scene, starts_free=case.starts_free)
    model, contact = path.model, case.contact_m(scene)
    found = surface_traction(model, point)
    sample = on_circles(model, point, reach_m=(1.25 if case.within == 1.0 else 1.0) * contact)
    shear = sample(found.tangential_pa)
    return Sampled(
        scene=scene,
        point=point,
        force_n=point.force_n,
        contact_m=contact,
        pressure=sample(found.pressure_pa),
        shear=shear.polar(),
        along=replace(shear, values=shear.values[..., 0]),
    )


def _pressed(scene: Scene, *, starts_free: bool) -> tuple[LoadingPath, PathPoint]:
    plan = plan_effects(scene)
    felt = regularised_indenter(scene)
    path = LoadingPath(build_model(scene, plan=plan), felt)
    if not starts_free:
        return path, path.advance(_depth(scene))
    smooth = replace(
        scene, contact=ContactMode.FRICTIONLESS, effects=((Effect.LOCKING_FREE_ELEMENT, True),)
    )
    free = build_model(smooth, plan=plan_effects(smooth), mesh=path.model.mesh)
    point = LoadingPath(free, felt).advance(_depth(scene))
    state, contact = point.state.copy(), point.equilibrium.contact
    state.grip = Grip(
        held=np.any(contact.forces != 0.0, axis=2).astype(np.int32),
        anchors=contact.points - state.tip,
        loads=-contact.forces / free.surface.areas[..., None],
    )
    path.advance(point.depth_m, start=replace(point, state=state))
    motion = scene.motion
    return path, path.carry(shift_m=motion.shift_m, twist_rad=motion.twist_rad)


_RADII, _ANGLES = 80, 96


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundField:
    """A field on circles about an axis.

    Attributes:
        radii_m: Shape [radius_count].
        angles_rad: Shape [angle_count].
        values: Shape [radius_count, angle_count, ...].
    """

    radii_m: FloatArray
    angles_rad: FloatArray
    values: FloatArray

    def error_relative(self, exact: FloatArray, *, within_m: float) -> float:
        """Return the L2 norm of the difference over that of the exact field, up to a radius."""
        inside = self.radii_m < within_m
        weight = self.radii_m[inside]

        def size(values: FloatArray) -> float:
            square = values[inside].reshape(len(weight), -1) ** 2
            return float(weight @ square.sum(axis=1))

        off = self.values - exact
        return float(np.sqrt(size(off) / size(self.values - off)))

    @property
    def round(self) -> FloatArray:
        """Mean over every circle, shape [radius_count, ...]."""
        return np.asarray(self.values.mean(axis=1))

    def asymmetry_relative(self, *, within_m: float) -> float:
        """Return the largest deviation from the mean over a circle, over the largest value."""
        inside = self.values[self.radii_m < within_m]
        off = inside - inside.mean(axis=1, keepdims=True)
        return float(np.abs(off).max() / np.abs(inside).max())

    def polar(self) -> RoundField:
        """Return a vector field by its parts away from and around the axis, and upwards."""
        cos, sin = np.cos(self.angles_rad), np.sin(self.angles_rad)
        x, y, z = np.moveaxis(self.values, -1, 0)
        parts = np.stack([x * cos + y * sin, y * cos - x * sin, z], axis=-1)
        return RoundField(radii_m=self.radii_m, angles_rad=self.angles_rad, values=parts)


def on_circles(
    model: Model, point: PathPoint, *, reach_m: float
) -> Callable[[FloatArray], RoundField]:
    """Return what samples a nodal field of the model on circles about the indenter's tip.

    Args:
        reach_m: Radius of the largest circle [m].
    """
    top = top_surface(model)
    places = top.of(point.state.positions)[:, :2] - point.state.tip[:2]
    radii = reach_m * (np.arange(_RADII) + 0.5) / _RADII
    angles = 2.0 * np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
    x, y = np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))
    corners = top.faces[:, :3]
    plan = matplotlib.tri.Triangulation(places[:, 0], places[:, 1], corners)
    face = np.asarray(plan.get_trifinder()(x, y)).reshape(-1)
    a, b, c = (places[corners[face, k]] for k in range(3))
    sides = np.stack([b - a, c - a], axis=2)
    along = np.linalg.solve(sides, (np.column_stack([x.ravel(), y.ravel()]) - a)[..., None])[..., 0]
    shares = np.column_stack([1.0 - along.sum(axis=1), along])
    if top.faces.shape[1] == 6:
        shares = quadratic_triangle_values(shares)

    def sampled(nodal: FloatArray) -> RoundField:
        whole = nodal[top.sources]
        if nodal.ndim == 2:
            whole = whole * top.signs
        values: FloatArray = np.einsum("sk,sk...->s...", shares, whole[top.faces[face]])
        shape = (_RADII, _ANGLES, *nodal.shape[1:])
        return RoundField(radii_m=radii, angles_rad=angles, values=values.reshape(shape))

    return sampled
