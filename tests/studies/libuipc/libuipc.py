"""A libuipc scene of pads side by side, each beneath its own rigid indenter.

libuipc moves a rigid body towards where it should be by a spring. Ours is stiff enough that the
force of a press shortens a millimetre of travel by half a micrometre; the tip's true place is read
back all the same. Gravity and velocities are off, the gel has next to no mass, and gel does not
touch gel.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError
from tests.studies.libuipc.task import FRAME_S, PeerFound, PeerTask

_GEL_KG_M3 = 1.0
_STEEL_KG_M3 = 8000.0
# Of the spring that moves an indenter [N/m], and of the indenter itself [Pa].
_DRIVE_N_M = 1e7
_RIGID_PA = 1e10
# Indenters go back through every fourth of their poses.
_LIFT_STRIDE = 4
_NEWTON = "newton_iterations"
_LIMITS = {"hit_newton_limit": "Newton", "hit_line_search_limit": "a line search"}
# No further press is timed after so much time [s], as of ours.
_ENOUGH_S = 6.0


class PeerWorld:
    """A scene that libuipc has taken.

    Args:
        folder: Where libuipc may write.
        backend: ``cuda``; ``none`` takes the scene and computes nothing.

    Attributes:
        gel: The pads' geometry.
        bodies: The indenters' geometry.
        aims: Transforms that the next frame goes to, in the pads' frames, shape [count, 4, 4].
    """

    def __init__(self, task: PeerTask, *, folder: str, backend: str = "cuda") -> None:
        self.uipc = importlib.import_module("uipc")
        self._parts = {
            name: importlib.import_module(f"uipc.{name}") for name in ("geometry", "constitution")
        }
        self.uipc.Logger.set_level(self.uipc.Logger.Level.Error)
        self.uipc.Timer.disable_all()
        self.task = task
        self.aims = task.start
        scene = self.uipc.Scene(self._settings())
        gel, body = self._gel(), self._bodies()
        self._contact(scene, gel, body)
        objects = [scene.objects().create(name) for name in ("gel", "indenter")]
        self._slots = [
            made.geometries().create(geometry)[0]
            for made, geometry in zip(objects, (gel, body), strict=True)
        ]
        self._indenter = objects[1]
        scene.animator().insert(self._indenter, self._move)
        self.scene = scene
        self.engine = self.uipc.Engine(backend, folder)
        self.world = self.uipc.World(self.engine)
        self.world.init(scene)

    @property
    def gel(self) -> Any:
        """The pads' geometry as it was last retrieved."""
        return self._slots[0].geometry()

    def go_to(self, poses: FloatArray) -> None:
        """Compute one frame: the indenters go to these poses, shape [count, 4, 4]."""
        self.aims = poses
        self.world.advance()

    def close(self) -> None:
        """Give the GPU's memory back: libuipc holds the animation, and that holds this."""
        self.scene.animator().erase(self._indenter.id())
        del self.world, self.engine, self.scene

    def frame_facts(self) -> dict[str, Any]:
        """Return what libuipc counted in the last frame."""
        return dict(self.engine.frame_stats())

    def read(self) -> tuple[FloatArray, FloatArray]:
        """Return nodes [count, node_count, 3] and tips [count, 3] in their pad's frame [m]."""
        self.world.retrieve()
        count, origins = self.task.count, self.task.origins_m
        nodes = np.array(self.uipc.view(self.gel.positions())).reshape(count, -1, 3)
        transforms = np.array(self.uipc.view(self._slots[1].geometry().transforms()))
        tips = transforms.reshape(count, 4, 4)[:, :3, 3]
        return nodes - origins[:, None], tips - origins

    def _settings(self) -> dict[str, Any]:
        settings = self.uipc.Scene.default_config()
        _merge(
            settings,
            {
                "dt": FRAME_S,
                "gravity": [[0.0], [0.0], [0.0]],
                "contact": {
                    "d_hat": self.task.distance_m,
                    "eps_velocity": self.task.slip_m / FRAME_S,
                    "friction": {"enable": int(self.task.friction > 0.0)},
                },
                "sanity_check": {"mode": "quiet"},
            },
        )
        _merge(settings, self.task.tolerance.settings())
        return dict(settings)

    def _gel(self) -> Any:
        task, view = self.task, self.uipc.view
        geometry, constitution = self._parts["geometry"], self._parts["constitution"]
        step = len(task.nodes) * np.arange(task.count)
        nodes = (task.nodes + task.origins_m[:, None]).reshape(-1, 3)
        tets = (task.tets + step[:, None, None]).reshape(-1, 4)
        gel = geometry.tetmesh(nodes, np.ascontiguousarray(tets, dtype=np.int32))
        geometry.label_surface(gel)
        geometry.label_triangle_orient(gel)
        moduli = constitution.ElasticModuli.lame(task.bulk_pa[0, 0], task.shear_pa[0, 0])
        constitution.StableNeoHookean().apply_to(gel, moduli, _GEL_KG_M3)
        # It names the law's two constants as Lame's, which they are not, and keeps them by element.
        for name, values in (("mu", task.shear_pa), ("lambda", task.bulk_pa)):
            view(gel.tetrahedra().find(name))[:] = values.reshape(-1)
        fixed = view(gel.vertices().find(self.uipc.builtin.is_fixed))
        fixed[:] = np.tile(task.clamped, task.count).astype(fixed.dtype)
        view(gel.vertices().find(self.uipc.builtin.is_dynamic))[:] = 0
        return gel

    def _bodies(self) -> Any:
        task, geometry, constitution = (
            self.task,
            self._parts["geometry"],
            self._parts["constitution"],
        )
        # It reads memory as it lies.
        faces = np.ascontiguousarray(task.body_faces, dtype=np.int32)
        body = geometry.trimesh(np.ascontiguousarray(task.body_vertices), faces)
        geometry.label_surface(body)
        constitution.AffineBodyConstitution().apply_to(body, _RIGID_PA, _STEEL_KG_M3)
        mass_kg = _STEEL_KG_M3 * float(body.meta().find("volume").view()[0])
        strength = _DRIVE_N_M * FRAME_S**2 / mass_kg
        constitution.SoftTransformConstraint().apply_to(body, np.array([strength, strength]))
        body.instances().resize(task.count)
        self.uipc.view(body.instances().find(self.uipc.builtin.is_dynamic))[:] = 0
        self.uipc.view(body.transforms())[:] = self._placed(task.start)
        return body

    def _placed(self, poses: FloatArray) -> FloatArray:
        """Return poses in the pads' frames in that of the scene, shape [count, 4, 4]."""
        found = poses.copy()
        found[:, :3, 3] += self.task.origins_m
        return found

    def _contact(self, scene: Any, gel: Any, body: Any) -> None:
        table = scene.contact_tabular()
        friction, resistance = self.task.friction, self.task.resistance
        table.default_model(0.0, resistance, False)
        elements = [table.create(name) for name in ("gel", "indenter")]
        for one, other, is_on in ((0, 0, False), (0, 1, True), (1, 1, False)):
            table.insert(elements[one], elements[other], friction, resistance, is_on)
        for element, geometry in zip(elements, (gel, body), strict=True):
            element.apply_to(geometry)

    def _move(self, info: Any) -> None:
        """Tell libuipc where the indenters go in this frame; it calls this itself."""
        instances = info.geo_slots()[0].geometry().instances()
        view, names = self.uipc.view, self.uipc.builtin
        view(instances.find(names.is_constrained))[:] = 1
        view(instances.find(names.aim_transform))[:] = self._placed(self.aims)


def _merge(settings: dict[str, Any], other: dict[str, Any]) -> None:
    """Overwrite the settings that ``other`` names, table by table."""
    for name, value in other.items():
        if isinstance(value, dict):
            _merge(settings[name], value)
        else:
            settings[name] = value


def contact_forces(world: PeerWorld) -> FloatArray | None:
    """Return the force on every node [N], shape [count, node_count, 3]; None if there is no way.

    libuipc keeps the gradient of its last assembly, that of energy times the square of a frame's
    time, at the positions from which the last Newton step started.
    """
    core, geometry = (importlib.import_module(f"uipc.{name}") for name in ("core", "geometry"))
    feature = world.world.features().find(core.ContactSystemFeature)
    if feature is None:
        return None
    count, node_count = world.task.count, len(world.task.nodes)
    found = np.zeros((count * node_count, 3))
    first = _first_vertex(world)
    for kind in feature.contact_primitive_types():
        pairs = geometry.Geometry()
        feature.contact_gradient(kind, pairs)
        vertices, gradients = (pairs.instances().find(name) for name in ("i", "grad"))
        if vertices is None or gradients is None:
            continue
        at = np.array(vertices.view()).reshape(-1) - first
        on_gel = (at >= 0) & (at < len(found))
        forces = -np.array(gradients.view()).reshape(-1, 3) / FRAME_S**2
        np.add.at(found, at[on_gel], forces[on_gel])
    return found.reshape(count, node_count, 3)


def _first_vertex(world: PeerWorld) -> int:
    """Return the number that libuipc gives the gel's first vertex among all."""
    offset = world.gel.meta().find(world.uipc.builtin.global_vertex_offset)
    return 0 if offset is None else int(np.array(offset.view()).reshape(-1)[0])


def press_in_libuipc(task: PeerTask, *, folder: str, backend: str = "cuda") -> PeerFound:
    """Press every environment along its trajectory: one press to warm up, then the timed ones.

    Between presses the indenters are lifted off; the gel then comes back to rest.

    Raises:
        ConvergenceError: libuipc has met an error.
    """
    started = time.perf_counter()
    world = PeerWorld(task, folder=folder, backend=backend)
    try:
        return _pressed(world, started)
    finally:
        world.close()


def _pressed(world: PeerWorld, started: float) -> PeerFound:
    task = world.task
    frames = _warm_up(world)
    set_up_s = time.perf_counter() - started
    times: list[tuple[float, float]] = []
    while len(times) < task.press_count and sum(wall for wall, _ in times) < _ENOUGH_S:
        _lift(world)
        times.append(_timed(world))
    positions, tips = world.read()
    problems = _limits(frames)
    if not task.friction:
        # Where nothing moves, with one step only, the gradient is that of the frame before. What
        # rubs would be let go there.
        world.go_to(task.poses[-1])
        world.world.sync()
        still = _counts([world.frame_facts()], _NEWTON)
        if any(steps > 1 for steps in still):
            problems.append(f"the frame that stands still took {still[0]} Newton steps")
    return PeerFound(
        set_up_s=set_up_s,
        press_s=tuple(times),
        newton_iterations=_counts(frames, _NEWTON),
        positions=positions,
        tips_m=tips,
        contact_n=contact_forces(world),
        problems=tuple(problems),
    )


def _warm_up(world: PeerWorld) -> list[dict[str, Any]]:
    """Press once, and return what libuipc says of every frame."""
    found = []
    for poses in world.task.poses:
        world.go_to(poses)
        _check(world)
        found.append(world.frame_facts())
    return found


def _timed(world: PeerWorld) -> tuple[float, float]:
    """Return the time of a press, of the wall and of the processor [s]."""
    world.world.sync()
    wall, cpu = time.perf_counter(), time.process_time()
    for poses in world.task.poses:
        world.go_to(poses)
    world.world.sync()
    found = time.perf_counter() - wall, time.process_time() - cpu
    _check(world)
    return found


def _lift(world: PeerWorld) -> None:
    """Go back the way that the indenters came; the second frame at first touch lets gel rest."""
    task = world.task
    for poses in (*task.poses[-1 - _LIFT_STRIDE :: -_LIFT_STRIDE], task.start, task.start):
        world.go_to(poses)


def _counts(frames: Sequence[dict[str, Any]], name: str) -> tuple[int, ...]:
    """Return a number of every frame that libuipc says it of."""
    return tuple(int(frame[name]) for frame in frames if name in frame)


def _limits(frames: Sequence[dict[str, Any]]) -> list[str]:
    """Say in how many frames an iteration ended at its limit."""
    found = []
    for name, what in _LIMITS.items():
        hit = sum(_counts(frames, name))
        if hit:
            found.append(f"{hit} of {len(frames)} frames ended {what} at its limit")
    return found


def _check(world: PeerWorld) -> None:
    if not world.world.is_valid():
        raise ConvergenceError(
            f"libuipc has met an error in frame {world.world.frame()}",
            remedy="see its own messages above",
        )
