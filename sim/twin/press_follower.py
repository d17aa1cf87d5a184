"""A simulated press that follows a real one: to each new force or depth from where it stands."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import warp as wp
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from sim.device import Device
from sim.effects.effect_choice import plan_effects
from sim.effects.press_outputs import outputs_of
from sim.effects.press_with_effects import CoarsePath, path_for
from sim.error_estimate import coarse_reference, estimate_from
from sim.fields.pressure_and_shear import surface_traction
from sim.fields.saved_press import top_surface
from sim.optics.colour.model_interface_and_response import ColourModel
from sim.optics.surface_images import SurfaceImages
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.camera_geometry import CameraGeometry
from sim.sensor.sensor import Sensor
from sim.solve.loading_path import LoadingPath
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray, ImageArray
from tacauchy_rig.core.errors import ConfigError, ConvergenceError, RigError

_SHARES = (0.25, 0.5, 1.0)  # of the largest force: between them the error goes evenly


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Where the gel stands now: one of force and depth is given."""

    stamp_s: float  # when that was measured, on any clock that goes on evenly [s]
    force_n: float | None = None  # tared pressing force F_z [N]
    depth_m: float | None = None  # travel below first touch [m]

    @property
    def touches(self) -> bool:
        """Whether anything is pressed."""
        return (self.depth_m or 0.0) > 0.0 or (self.force_n or 0.0) > 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinFrame:
    """The twin at one goal."""

    goal: Goal
    force_n: float  # its F_z [N]; zero where nothing touches
    force_error_n: float | None  # 95 % of such presses err by less [N]; None where unknown
    depth_m: float  # travel below first touch [m]
    image: ImageArray  # what the camera would show, RGB, uint8, shape [height, width, 3]
    # On the gel where the image's pixels look, [rows, columns]; None where it was not asked for
    pressure_pa: FloatArray | None
    shear_pa: FloatArray | None  # size of the tangential traction there, likewise
    solve_s: float
    draw_s: float  # time that image and maps took [s]
    note: str = ""  # why the frame is not of its goal; empty where it is


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedForceError:
    """Relative errors of F_z at ascending forces; where none is known, ``basis`` says why."""

    forces_n: Sequence[float] = ()
    relative: Sequence[float] = ()
    basis: str

    def error_n(self, force_n: float) -> float | None:
        """Return the stated error of a force [N]; None where it is unknown."""
        if not self.forces_n:
            return None
        return force_n * float(np.interp(force_n, self.forces_n, self.relative))


def stated_force_error(scene: Scene, path: LoadingPath, force_max_n: float) -> StatedForceError:
    """Press a scene's path and preset fast's to some forces, and state the errors of the former's.

    On edges longer than preset fast's nothing is known of what is left (a punch is off by more than
    the rules of errors say there), so the difference to preset fast is measured, and the
    estimated error of preset fast is added. The path is left at the largest force.
    """
    fast = replace(scene, refinement=1.0)
    plan = plan_effects(fast)
    forces, relative, basis = [share * force_max_n for share in _SHARES], [], ""
    try:
        finer, coarser = path_for(fast, plan), CoarsePath(*coarse_reference(fast, plan))
        for force in forces:
            aimed = replace(fast, target=Target(force_n=force))
            own, found = (outputs_of(each, each.push(force)) for each in (path, finer))
            worth = estimate_from(aimed, plan, found, coarser.push(force))
            if worth.force is None:
                return StatedForceError(basis=worth.basis)
            share = max(1.0, found.stiffness_n_m * found.depth_m / force)
            apart = share * abs(own.depth_m - found.depth_m) / found.depth_m
            relative.append(apart + worth.force)
            basis = f"{apart:.2%} off preset fast; of that {worth.basis}"
    except RigError as error:
        return StatedForceError(basis=f"the press on shorter edges failed: {error.message}")
    return StatedForceError(forces_n=forces, relative=relative, basis=basis)


REFINEMENT, COARSER = 0.7, 0.5
"""Edges of a twin are 1 / 0.7 times as long as those of preset fast, for a third of its time, and
twice as long where that still leaves too many."""
TETS_MAX = 500
"""All of ``bench --part twin`` have fewer: at most 24 ms of a core a frame, in the median."""
LOOSENED = 10.0
"""A twin's forces balance so many times less closely than a replay's: to 1e-5 of the contact's."""
NO_FORCE_N = 0.02  # less is noise of the cell, and no contact
_WAITING_N = 0.05  # where a gel without memory waits: the first touch takes the longest
_MAP_SHARE = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageOptions:
    """How a twin's images are made; None is what the sensor's file says."""

    width_px: int = 160  # of its images, at most; they are as high as that makes them
    colours: ColourModel | None = None  # colour of a surface
    geometry: CameraGeometry | None = None  # where the pixels of a whole image look
    blur_px: float = 0.0  # standard deviation of the camera's blur, in pixels of the whole image
    # Where they are drawn: ``cpu`` or ``cuda:0``. One press is too small for a GPU, and is solved
    # on a processor.
    device: str = "cpu"


def twin_scene(scene: Scene) -> Scene:
    """Return a press as a twin presses it: preset fast on longer edges, for its force alone."""
    alone = replace(scene, tolerance=None, output_tolerances=(), outputs=frozenset())
    return replace(alone, preset=Preset.FAST, refinement=REFINEMENT)


class Follower:
    """Presses a scene's indenter to goals as they come, and shows each.

    Warm: each press goes on from the last. Where one fails, and where a gel that remembers lost
    contact, the next begins with an untouched gel. The scene's target is the largest force that
    will come.

    Attributes:
        stated_error: The stated error of its forces.
        view: Where the pixels of its images look.

    Raises:
        ConfigError: The scene has no force for a target, or cannot be built.
        ConvergenceError: Not even the scene itself can be pressed.
    """

    def __init__(self, scene: Scene, sensor: Sensor, options: ImageOptions | None = None) -> None:
        force_max_n = scene.target.force_n
        if not force_max_n:
            raise ConfigError("a twin's scene has no force for a target", remedy="give the largest")
        self._options = options or ImageOptions()
        self._sensor = sensor
        for refinement in (REFINEMENT, COARSER):
            self._scene = replace(twin_scene(scene), refinement=refinement)
            self._plan = plan_effects(self._scene)
            self._path = path_for(self._scene, self._plan)
            if len(self._path.model.elements) <= TETS_MAX:
                break
        self._drawn_from = self._path.model.on(self._options.device)
        whole = self._options.geometry or sensor.camera
        share = min(1.0, self._options.width_px / whole.width)
        self.view, self._blur_px = whole.refined(share), share * self._options.blur_px
        top, self._map_view = top_surface(self._path.model), self.view.refined(_MAP_SHARE)
        self._map_mesh, self._map_nodes = Delaunay(top.rest[:, :2]), top.sources
        self.stated_error = stated_force_error(self._scene, self._path, force_max_n)
        self._begin_anew()
        self._wait()
        self._last: PathPoint | None = None
        self._stamp_s: float | None = None
        self.unloaded(None)

    def unloaded(self, background: ImageArray | None) -> None:
        """Take a no-contact frame, RGB, uint8, of ``view``'s size, for later; None is even grey."""
        self._images = SurfaceImages(
            self._drawn_from,
            self._scene.indenter,
            self._sensor,
            count=1,
            background=background,
            colours=self._options.colours,
            geometry=self.view,
            blur_px=self._blur_px,
        )
        above = np.array([0.0, 0.0, 1.0])
        self._untouched = self._drawn(self._path.unloaded, above, self._path.rotation)

    def follow(self, goal: Goal, *, maps: bool = True) -> TwinFrame:
        """Press on to a goal, or back to it, and show that; a press that fails shows the last.

        Less than 0.02 N is no contact. Maps of pressure and shear take as long as the rest.
        """
        started, note = time.perf_counter(), ""
        if not goal.touches or (goal.force_n is not None and goal.force_n < NO_FORCE_N):
            if self._last is not None:
                self._wait()
            self._last = None
        else:
            try:
                self._last = self._pressed(goal)
            except ConvergenceError as error:
                note = f"shows the press before: {error.message}"
                self._begin_anew()
        self._stamp_s = goal.stamp_s
        solved = time.perf_counter()
        return self._shown(goal, self._last, note, solve_s=solved - started, maps=maps)

    def _pressed(self, goal: Goal) -> PathPoint:
        remembers = self._path.model.relaxation is not None
        spent_s = None if self._stamp_s is None else max(0.0, goal.stamp_s - self._stamp_s)
        duration_s = spent_s if remembers else None
        if goal.force_n is not None:
            return self._path.push(goal.force_n, duration_s=duration_s)
        return self._path.advance(goal.depth_m or 0.0, duration_s=duration_s)

    def _wait(self) -> None:
        """Make ready for the next contact, while nothing is waited for."""
        model = self._path.model
        if model.relaxation is not None or model.contact_options.is_tangential:
            self._begin_anew()
            return
        try:
            self._path.push(_WAITING_N)
        except ConvergenceError:
            self._begin_anew()

    def _begin_anew(self) -> None:
        model = self._path.model
        self._path = path_for(self._scene, self._plan, model=model)
        own = self._path.options
        loosened = LOOSENED * own.residual_relative
        self._path.options = replace(own, residual_relative=loosened, load_relative=loosened)

    def _shown(
        self, goal: Goal, point: PathPoint | None, note: str, *, solve_s: float, maps: bool
    ) -> TwinFrame:
        started = time.perf_counter()
        force = 0.0 if point is None else float(point.force_n[2])
        image = self._untouched
        if point is not None:
            image = self._drawn(point.state.positions, point.state.tip, point.state.rotation)
        pressure, shear = self._traction_maps(point) if maps else (None, None)
        return TwinFrame(
            goal=goal,
            force_n=force,
            force_error_n=self.stated_error.error_n(force),
            depth_m=0.0 if point is None else point.depth_m,
            image=image,
            pressure_pa=pressure,
            shear_pa=shear,
            solve_s=solve_s,
            draw_s=time.perf_counter() - started,
            note=note,
        )

    def _traction_maps(self, point: PathPoint | None) -> tuple[FloatArray, FloatArray]:
        """Return pressure and shear [Pa] on the gel that lies at rest where a pixel looks."""
        shape = (self._map_view.height, self._map_view.width)
        if point is None:
            return np.zeros(shape), np.zeros(shape)
        found = surface_traction(self._path.model, point)
        sizes = np.linalg.norm(found.tangential_pa, axis=1)
        values = np.column_stack([found.pressure_pa, sizes])[self._map_nodes]
        between = LinearNDInterpolator(self._map_mesh, values, fill_value=0.0)
        pressure, shear = np.moveaxis(between(*self._map_view.pad_grid()), -1, 0)
        return pressure, shear

    def _drawn(self, nodes: FloatArray, tip: FloatArray, rotation: FloatArray) -> ImageArray:
        device, kinds = Device(self._options.device), (wp.vec3d, wp.vec3d, wp.mat33d)
        placed = zip((nodes, tip, rotation), kinds, strict=True)
        images = self._images.images(*(device.array(each[None], kind) for each, kind in placed))
        return np.array(images.numpy()[0])
