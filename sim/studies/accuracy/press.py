"""One way to simulate a press: what it gives, and how long it takes."""

from __future__ import annotations

import time
import tomllib
from dataclasses import dataclass, field, replace
from importlib import resources

import numpy as np
from pydantic import TypeAdapter

from sim.correction import correction
from sim.effects.effect_plan import EffectPlan
from sim.effects.end_state import EndState, end_state
from sim.effects.outputs import outputs_of
from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.fields.contact_traction import surface_traction
from sim.fields.press_fields import surface_state
from sim.mesh.elements import ElementOrder
from sim.optics.height.height_map import HeightMaps, height_maps
from sim.press import contact_measures
from sim.scene.scene import Effect, Preset, Scene
from sim.sensor.camera_geometry import CameraGeometry
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath
from tacauchy_rig.core.arrays import FloatArray

COARSENING = 1.5
_TOUCHING_M = 6e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Configuration:
    """One way to simulate a press.

    Attributes:
        name: Short, for the figure and the table.
        preset: Whose mesh is taken.
        element: Linear or quadratic tetrahedra.
        finite_strain: Hyperelastic; else Hooke's law on the undeformed pad.
        barrier_m: d_hat [m]; None is the scene's choice.
        residual_relative: Where Newton ends, over the contact force's norm.
        refinement: Every edge this many times shorter than the preset's.
        path_refinement: The same of the mesh of the way, where that is another.
        is_corrected: The bias that such a mesh has is taken off force and depth.
    """

    name: str
    preset: Preset
    element: ElementOrder = ElementOrder.P2
    finite_strain: bool = True
    barrier_m: float | None = None
    residual_relative: float = SolverOptions().residual_relative
    refinement: float = 1.0
    path_refinement: float | None = None
    is_corrected: bool = False

    @property
    def is_preset(self) -> bool:
        """The settings are exactly those that a user gets by the preset's name."""
        plain = Configuration(
            name=self.name,
            preset=self.preset,
            element=ElementOrder.P1 if self.preset is Preset.PAPER else ElementOrder.P2,
        )
        return self == plain

    def applied(self, scene: Scene) -> Scene:
        """Return the scene with these settings."""
        quadratic = self.element is ElementOrder.P2
        return replace(
            scene,
            preset=self.preset,
            barrier_m=self.barrier_m,
            effects=(
                *scene.effects,
                (Effect.LOCKING_FREE_ELEMENT, quadratic),
                (Effect.FINITE_STRAIN, self.finite_strain),
            ),
        )

    def on_its_way(self, scene: Scene) -> Scene:
        """Return a scene whose end is on another mesh than its way."""
        return replace(scene, refinement=self.refinement, path_refinement=self.path_refinement)

    def refined(self, factor: float) -> Configuration:
        """Return the same settings with every edge so many times shorter."""
        return replace(self, refinement=self.refinement * factor)


def coarser(reference: Configuration) -> Configuration:
    """Return a reference's settings with edges 1.5 times as long, for its own error."""
    return replace(reference.refined(1.0 / COARSENING), name=f"{reference.name}, coarser")


_FILE = resources.files("sim.studies.accuracy").joinpath("configurations.toml")
SHORT, _LONG = (
    TypeAdapter(tuple[Configuration, ...]).validate_python(rows)
    for rows in tomllib.loads(_FILE.read_text("utf-8")).values()
)
FULL = (*SHORT, *_LONG)
REFERENCE = Configuration(name="reference", preset=Preset.REFERENCE)
# What is pressed on two more meshes; the finer ones would take longer than all of these.
SHIFTED = tuple(
    each
    for each in SHORT
    if (each.element is ElementOrder.P1 and each.preset is not Preset.PAPER)
    or each.name in ("fast / 4", "fast / 2", "fast")
)


def reseeded(configuration: Configuration, seed: int) -> Configuration:
    """Return the same settings on another mesh: edges shorter or longer by up to 7 %.

    The meshes of the presets are built, not drawn, so that a seed can only mean another size. The
    paper's mesh is the one that ships: fTetWild does not give the same one twice.
    """
    if seed == 0 or configuration.preset is Preset.PAPER:
        return configuration
    shift = ((0.618034 * seed) % 1.0 - 0.5) * 0.14
    return configuration.refined(1.0 + shift)


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A configuration's errors and cost.

    Attributes:
        errors: By quantity: relative errors, with their sign, of F_z at the reference's depth, and
            of depth, largest pressure and contact radius at the force; RMS error of the height over
            the deepest indentation; 1 - SSIM of the image.
        chances: By quantity: how far its error may be off for what its mesh happens to cut; empty
            where that was not measured.
        zncc_contact: Correlation with the reference's image inside the contact.
        setup_s: Meshing, upload and symbolic factorisation [s].
        solve_s: From the unloaded gel to the force [s].
        cpu_s: Processor time of both [s].
        steps: Increments on the way.
        on_front: No configuration that is at least as fast is closer in F_z.
    """

    configuration: Configuration
    errors: dict[str, float] = field(default_factory=dict)
    chances: dict[str, float] = field(default_factory=dict)
    zncc_contact: float = np.nan
    setup_s: float = np.nan
    solve_s: float = np.nan
    cpu_s: float = np.nan
    steps: int = 0
    newton_iterations: int = 0
    tet_count: int = 0
    node_count: int = 0
    on_front: bool = False

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
    """A press to a force.

    Attributes:
        row: Its settings and cost; errors are not known yet.
        force_n: The force that was asked for [N].
        depth_m: Where it is reached [m], corrected if that was asked for.
        pressure_max_pa: Largest contact pressure [Pa].
        contact_radius_m: Radius of the disc of the contact's area [m].
        maps: Height maps at the image's resolution.
        bias: What is taken off the forces of the path, relative.
    """

    row: Row
    force_n: float
    depth_m: float
    pressure_max_pa: float
    contact_radius_m: float
    maps: HeightMaps
    path: LoadingPath
    bias: float = 0.0

    def force_at(self, depth_m: float) -> float:
        """Press on, or back, to a depth [m] and return F_z there [N].

        Raises:
            ConvergenceError: The gel cannot be pressed that far.
        """
        return float(self.path.advance(depth_m).force_n[2]) / (1.0 + self.bias)


def observe(scene: Scene, configuration: Configuration, geometry: CameraGeometry) -> Observation:
    """Press a scene to its force with one configuration; the kernels should be warm.

    Raises:
        ConvergenceError: The force cannot be reached with these settings.
        ConfigError: The scene cannot be meshed so.
    """
    scene = configuration.applied(scene)
    force = scene.target.force_n or 0.0
    started, spent = time.perf_counter(), time.process_time()
    plan = plan_effects(scene)
    end = _end(scene, plan, configuration)
    pressed, spent = time.perf_counter() - started, time.process_time() - spent
    path, point, model = end.path, end.point, end.path.model
    corrected = None
    if configuration.is_corrected:
        corrected = correction(
            configuration.on_its_way(scene), plan, outputs_of(path, point), end.way
        )
    contact = contact_measures(path, point)
    # A large d_hat holds the gel off the indenter: what touches is what the barrier reaches.
    wide = model.contact_options.is_wide
    touching = _TOUCHING_M if wide else max(_TOUCHING_M, scene.contact_distance_m)
    row = Row(
        configuration=configuration,
        setup_s=pressed - path.counts.wall_s,
        solve_s=path.counts.wall_s,
        cpu_s=spent,
        steps=path.counts.increments,
        newton_iterations=path.counts.newton_iterations,
        tet_count=len(model.elements),
        node_count=len(model.nodes),
    )
    return Observation(
        row=row,
        force_n=force,
        depth_m=point.depth_m if corrected is None else corrected.depth_m,
        bias=0.0 if corrected is None else corrected.bias_relative,
        pressure_max_pa=float(surface_traction(model, point).pressure_pa.max()),
        contact_radius_m=float(np.sqrt(contact.area_seen_m2 / np.pi)),
        maps=height_maps(surface_state(path, point), geometry, contact_gap_m=touching),
        path=path,
    )


def _end(scene: Scene, plan: EffectPlan, configuration: Configuration) -> EndState:
    """Press to a scene's force, on one mesh or on two."""
    options = SolverOptions(residual_relative=configuration.residual_relative)
    if configuration.path_refinement is not None:
        return end_state(configuration.on_its_way(scene), plan, options=options)
    path = path_for(scene, plan, refinement=configuration.refinement)
    path.options = options
    return EndState(path=path, point=path.push(scene.target.force_n or 0.0))


def height_error(found: HeightMaps, reference: HeightMaps) -> float:
    """Return the RMS error of the height where the gel moves, over the deepest indentation.

    Only pixels count where the reference moves by more than 2 % of its deepest indentation.
    """
    moved: FloatArray = reference.rest - reference.loaded
    deepest = float(moved.max())
    region = np.abs(moved) > 0.02 * deepest
    error = (found.loaded - found.rest) - (reference.loaded - reference.rest)
    return float(np.sqrt(np.mean(error[region] ** 2))) / deepest
