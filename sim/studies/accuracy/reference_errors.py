"""One press simulated in many ways, each judged by a reference whose own error is shown."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from pydantic import TypeAdapter

from sim.effects.effect_choice import plan_effects
from sim.effects.press_outputs import outputs_of
from sim.effects.press_with_effects import EndState, end_state, path_for
from sim.fields.pressure_and_shear import contact_measures, surface_traction
from sim.fields.saved_press import surface_state
from sim.mesh.elements import ElementOrder
from sim.mesh_bias_correction import correction
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.scene.scene import Effect, Preset, Scene
from sim.sensor.camera_geometry import CameraGeometry
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath
from sim.studies import from_file
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import RigError

COARSENING = 1.5
QUANTITIES = ("force", "depth", "pressure", "radius", "height", "image")
_TOUCHING_M = 6e-6
_ORDER_LOW, ORDER_SHARP, ORDER_SMOOTH = 1.0, 1.0, 2.0
EDGE_SHIFT = 0.07
# What finer meshes, on which nothing was measured, may have of an error for their chance.
_SHARE_MIN, _SHARE_MAX = 0.25, 1.0
# Of what was extrapolated.
_DOUBT_SHARE = 0.5

Errors = Mapping[str, float]
Render = Callable[[HeightMaps], ImageArray]
Similarity = Callable[[ImageArray, ImageArray, HeightMaps], tuple[float, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Configuration:
    """One way to simulate a press."""

    name: str  # short, for the figure and the table
    preset: Preset  # whose mesh is taken
    element: ElementOrder = ElementOrder.P2
    finite_strain: bool = True  # hyperelastic; else Hooke's law on the undeformed pad
    barrier_m: float | None = None  # d_hat; None is the scene's choice
    residual_relative: float = SolverOptions().residual_relative
    refinement: float = 1.0  # every edge this many times shorter than the preset's
    path_refinement: float | None = None  # the same of the mesh of the way, where that is another
    is_corrected: bool = False  # the bias of such a mesh is taken off force and depth

    @property
    def is_preset(self) -> bool:
        """The settings are exactly those that a user gets by the preset's name."""
        element = ElementOrder.P1 if self.preset is Preset.PAPER else ElementOrder.P2
        return self == Configuration(name=self.name, preset=self.preset, element=element)

    def applied(self, scene: Scene) -> Scene:
        """Return the scene with these settings, but for what belongs to an end on another mesh."""
        quadratic = self.element is ElementOrder.P2
        own = (Effect.LOCKING_FREE_ELEMENT, quadratic), (Effect.FINITE_STRAIN, self.finite_strain)
        effects = (*scene.effects, *own)
        return replace(scene, preset=self.preset, barrier_m=self.barrier_m, effects=effects)

    def refined(self, factor: float) -> Configuration:
        """Return the same settings with every edge so many times shorter."""
        return replace(self, refinement=self.refinement * factor)


SHORT, _LONG = (
    TypeAdapter(tuple[Configuration, ...]).validate_python(rows)
    for rows in from_file("accuracy/configurations.toml").values()
)
FULL = (*SHORT, *_LONG)
REFERENCE = Configuration(name="reference", preset=Preset.REFERENCE)


def reseeded(configuration: Configuration, seed: int) -> Configuration:
    """Return the same settings on another mesh: edges shorter or longer by up to 7 %.

    The meshes of the presets are built, not drawn, so that a seed can only mean another size. The
    paper's mesh is the one that ships: fTetWild does not give the same one twice. The bias is known
    of some edges only.
    """
    if seed == 0 or configuration.is_corrected or configuration.preset is Preset.PAPER:
        return configuration
    shift = ((0.618034 * seed) % 1.0 - 0.5) * 0.14
    return configuration.refined(1.0 + shift)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A configuration's errors and cost."""

    configuration: Configuration
    # By quantity: relative errors, with their sign, of F_z at the reference's depth, and of depth,
    # largest pressure and contact radius at the force; RMS error of the height over the deepest
    # indentation; 1 - SSIM of the image
    errors: dict[str, float] = field(default_factory=dict)
    # By quantity: how far its error may be off for what its mesh happens to cut; empty where that
    # was not measured
    chances: dict[str, float] = field(default_factory=dict)
    zncc_contact: float = np.nan  # correlation with the reference's image inside the contact
    setup_s: float = np.nan  # meshing, upload and symbolic factorisation
    solve_s: float = np.nan  # from the unloaded gel to the force
    cpu_s: float = np.nan  # processor time of both
    steps: int = 0  # increments on the way
    newton_iterations: int = 0
    tet_count: int = 0
    node_count: int = 0
    on_front: bool = False  # no configuration that is at least as fast is closer in F_z

    @property
    def wall_s(self) -> float:
        """Set-up and solve [s]."""
        return self.setup_s + self.solve_s

    @property
    def time_s(self) -> float:
        """Set-up and solve, without what they waited for a processor that others used [s]."""
        return min(self.wall_s, self.cpu_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """A press to a force."""

    row: Row  # settings and cost; errors are not known yet
    force_n: float  # the force that was asked for
    depth_m: float  # where it is reached, corrected if that was asked for
    pressure_max_pa: float
    contact_radius_m: float  # of the disc of the contact's area
    maps: HeightMaps
    path: LoadingPath
    bias: float = 0.0  # what is taken off the forces of the path, relative

    def force_at(self, depth_m: float) -> float:
        """Press on, or back, to a depth [m] and return F_z there [N]."""
        return float(self.path.advance(depth_m).force_n[2]) / (1.0 + self.bias)


def observe(scene: Scene, configuration: Configuration, geometry: CameraGeometry) -> Observation:
    """Press a scene to its force with one configuration; the kernels should be warm."""
    scene = configuration.applied(scene)
    longer = configuration.path_refinement
    way = replace(scene, refinement=configuration.refinement, path_refinement=longer)
    started, spent = time.perf_counter(), time.process_time()
    plan = plan_effects(scene)
    options = SolverOptions(residual_relative=configuration.residual_relative)
    if longer is not None:
        end = end_state(way, plan, options=options)
    else:
        path = path_for(scene, plan, refinement=configuration.refinement)
        path.options = options
        end = EndState(path=path, point=path.push(scene.target.force_n or 0.0))
    pressed, spent = time.perf_counter() - started, time.process_time() - spent
    path, point, model = end.path, end.point, end.path.model
    corrected = None
    if configuration.is_corrected:
        corrected = correction(way, plan, outputs_of(path, point), end.way)
    # A large d_hat holds the gel off the indenter: what touches is what the barrier reaches.
    wide = model.contact_options.is_wide
    touching = _TOUCHING_M if wide else max(_TOUCHING_M, scene.contact_distance_m)
    counts = path.counts
    return Observation(
        row=Row(
            configuration=configuration,
            setup_s=pressed - counts.wall_s,
            solve_s=counts.wall_s,
            cpu_s=spent,
            steps=counts.increments,
            newton_iterations=counts.newton_iterations,
            tet_count=len(model.elements),
            node_count=len(model.nodes),
        ),
        force_n=scene.target.force_n or 0.0,
        depth_m=point.depth_m if corrected is None else corrected.depth_m,
        bias=0.0 if corrected is None else corrected.bias_relative,
        pressure_max_pa=float(surface_traction(model, point).pressure_pa.max()),
        contact_radius_m=float(np.sqrt(contact_measures(model, point).area_seen_m2 / np.pi)),
        maps=height_maps(surface_state(path, point), geometry, contact_gap_m=touching),
        path=path,
    )


def height_error(found: HeightMaps, reference: HeightMaps) -> float:
    """Return the RMS error of the height where the gel moves, over the deepest indentation.

    Only pixels count where the reference moves by more than 2 % of its deepest indentation.
    """
    moved: FloatArray = reference.rest - reference.loaded
    deepest = float(moved.max())
    error = ((found.loaded - found.rest) + moved)[np.abs(moved) > 0.02 * deepest]
    return float(np.sqrt(np.mean(error**2))) / deepest


class Limit(NamedTuple):
    """What F_z, or a depth, tends to, and the relative error that this may have."""

    value: float
    doubt: float


def extrapolated(value: float, coarser: float, *, scene: Scene) -> Limit:
    """Return the limit beyond a value and one on edges 1.5 times as long (Richardson 1911).

    Both are taken to converge at order 2, or 1 under a sharp rim, where stress is singular.
    """
    order = ORDER_SHARP if scene.has_sharp_rim else ORDER_SMOOTH
    limit = value + (value - coarser) / (COARSENING**order - 1.0)
    return Limit(limit, _DOUBT_SHARE * abs(value / limit - 1.0))


class Judge:
    """Compares presses with a reference.

    F_z and depth are compared with the limit that the reference and the same on edges 1.5 times as
    long tend to, half of what was extrapolated being its bar. Everything else is compared with the
    reference itself, whose bar is what order 1 would leave, which is too much where the contact is
    smooth: the larger of what that reference and the same on edges 2.25 times as long tell, since
    two meshes may agree by chance, and of what edges longer and shorter by a seed's share change.

    Attributes:
        bars: By quantity: how far what is compared with may be from the truth.
        reference: The reference's own row.

    Args:
        scene: A press to a force.
        render: Turns height maps into the tactile image.
        similarity: SSIM of two images, and their correlation inside the contact.
    """

    def __init__(
        self,
        scene: Scene,
        geometry: CameraGeometry,
        reference: Configuration,
        *,
        render: Render,
        similarity: Similarity,
    ) -> None:
        self._scene, self._geometry = scene, geometry
        self._render, self._similarity = render, similarity
        self._warm_up()
        coarser = reference.refined(1.0 / COARSENING)
        three = reference, coarser, coarser.refined(1.0 / COARSENING)
        exact, coarse, coarsest = map(self._observe, three)
        self._exact, self._image = exact, render(exact.maps)
        self._force, self._depth = exact.force_n, exact.depth_m
        drift, further = self._row(coarse).errors, self._row(coarsest).errors
        first, second = (1.0 / (COARSENING ** (k * _ORDER_LOW) - 1.0) for k in (1, 2))
        force = extrapolated(self._force, (1.0 + drift["force"]) * self._force, scene=scene)
        depth = extrapolated(self._depth, coarse.depth_m, scene=scene)
        self._force, self._depth = force.value, depth.value
        self.bars = {
            name: max(first * abs(error), second * abs(further[name]))
            for name, error in drift.items()
        }
        self.reference = self._row(exact)
        for name, apart in self._apart(self.reference).items():
            self.bars[name] = max(self.bars[name], apart)
        self.bars |= {"force": force.doubt, "depth": depth.doubt}

    def row(self, configuration: Configuration, *, shifted: bool = False) -> Row:
        """Press with a configuration, and return its errors and cost.

        Args:
            shifted: Press on edges longer and shorter by as much as a seed may make them too, for
                what a mesh happens to cut.
        """
        if configuration == self.reference.configuration:
            return self.reference
        row = self._row(self._observe(configuration))
        return replace(row, chances=self._apart(row)) if shifted else row

    def _apart(self, row: Row) -> dict[str, float]:
        """Return how far errors change on shifted edges; empty where these cannot be pressed."""
        with suppress(RigError):
            others = [
                self._row(self._observe(row.configuration.refined(factor))).errors
                for factor in (1.0 - EDGE_SHIFT, 1.0 + EDGE_SHIFT)
            ]
            return {
                name: max(abs(other[name] - error) for other in others)
                for name, error in row.errors.items()
            }
        return {}

    def _observe(self, configuration: Configuration) -> Observation:
        return observe(self._scene, configuration, self._geometry)

    def _row(self, found: Observation) -> Row:
        """Return an observation's row with its errors."""
        exact = self._exact
        ssim, zncc = self._similarity(self._image, self._render(found.maps), exact.maps)
        force = found.force_n if found is exact else found.force_at(exact.depth_m)
        errors = {
            "force": force / self._force - 1.0,
            "depth": found.depth_m / self._depth - 1.0,
            "pressure": found.pressure_max_pa / exact.pressure_max_pa - 1.0,
            "radius": found.contact_radius_m / exact.contact_radius_m - 1.0,
            "height": height_error(found.maps, exact.maps),
            "image": 1.0 - ssim,
        }
        return replace(found.row, errors=errors, zncc_contact=zncc)

    def _warm_up(self) -> None:
        """Compile every kernel that will be timed, on a mesh that costs next to nothing."""
        small = Configuration(name="warm-up", preset=Preset.FAST, refinement=0.25)
        for element, finite_strain in product(ElementOrder, (True, False)):
            with suppress(RigError):
                self._observe(replace(small, element=element, finite_strain=finite_strain))


def finished(rows: Sequence[Row]) -> list[Row]:
    """Return rows with the chances of all, and which of them are on the front of F_z."""
    known = [row for row in rows if row.chances]
    rows = [replace(row, chances=chances(row.configuration, row.errors, known)) for row in rows]
    front = front_of([(row.time_s, abs(row.errors["force"])) for row in rows])
    return [replace(row, on_front=on) for row, on in zip(rows, front, strict=True)]


def chances(
    configuration: Configuration, errors: Errors, measured: Sequence[Row]
) -> dict[str, float]:
    """Return the chance of a configuration's errors.

    That of its own mesh and element where it was measured; else the share of the error that it has
    on the finest mesh with such an element, between a quarter and all of it. The paper's mesh is
    but one and has none.

    Args:
        measured: What was found on the meshes that were shifted.
    """
    if configuration.preset is Preset.PAPER:
        return dict.fromkeys(errors, 0.0)
    alike = [row for row in measured if row.configuration.element is configuration.element]
    mesh = (configuration.preset, configuration.refinement)
    own = [row for row in alike if (row.configuration.preset, row.configuration.refinement) == mesh]
    near = own[0] if own else max(alike, key=lambda row: row.tet_count, default=None)
    scaled = {name: _share(near, name) * abs(error) for name, error in errors.items()}
    return {name: max(own[0].chances[name], scaled[name]) for name in errors} if own else scaled


def _share(near: Row | None, name: str) -> float:
    """Return the chance of an error over its size, as far as a finer mesh may have it."""
    if near is None or near.errors[name] == 0.0:
        return _SHARE_MIN
    return float(np.clip(near.chances[name] / abs(near.errors[name]), _SHARE_MIN, _SHARE_MAX))


def front_of(points: Sequence[tuple[float, float]]) -> list[bool]:
    """Return which (cost, error) points no other point beats in both; NaN is never on the front."""
    return [
        bool(np.isfinite(cost) and np.isfinite(error))
        and not any((c <= cost and e <= error and (c < cost or e < error)) for c, e in points)
        for cost, error in points
    ]


def error_bar(reference_bar: float, error: float, chance: float) -> float:
    """Return how far an error may be off: the reference's own part, and what its mesh may cut."""
    return (1.0 + abs(error)) * reference_bar + chance
