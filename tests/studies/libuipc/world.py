"""A libuipc scene of pads side by side, each beneath its own rigid indenter.

libuipc moves a rigid body towards where it should be by a spring. Ours is stiff enough that the
force of a press shortens a millimetre of travel by half a micrometre; the tip's true place is read
back all the same. Gravity and velocities are off, the gel has next to no mass, and gel does not
touch gel.
"""

import importlib
import json
import time
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from sim.studies.bench.scenes import Manner, ScenePress
from sim.studies.bench.timed_press import stated_scene, within
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError
from tests.studies.libuipc.pad import PeerPad, PeerPresses, peer_pad

# Time of a frame [s], libuipc's default. It does not matter: mass is as good as none.
FRAME_S = 0.01
AS_SHIPPED, STRICT = "as shipped", "step 1 um"
# Where Newton's iterations end: as it comes a frame may also end when a sixth step has been taken
# in full. Of steps of 1, 0.1 and 0.01 um the first balances best: 3.3 % where shipped settings
# leave 23 %, and 3.6 % at a sixth of the speed (docs/results/benchmarks/index.md).
SETTINGS: dict[str, dict[str, Any]] = {
    AS_SHIPPED: {},
    STRICT: {
        "newton": {"max_iter": 200, "velocity_tol": 1e-6 / FRAME_S, "semi_implicit": {"enable": 0}},
        # By how much conjugate gradients lower the squared, preconditioned residual.
        "linear_system": {"tol_rate": 1e-4},
    },
}
_GEL_KG_M3, _STEEL_KG_M3 = 1.0, 8000.0
# Of the spring that moves an indenter [N/m], and of the indenter itself [Pa].
_DRIVE_N_M, _RIGID_PA = 1e7, 1e10
# Indenters go back through every fourth of their poses.
_LIFT_STRIDE = 4
_NEWTON = "newton_iterations"
_LIMITS = {"hit_newton_limit": "Newton", "hit_line_search_limit": "a line search"}
# Timed presses at most, one more goes before; none begins after so much time [s], as of ours.
_PRESSES, _ENOUGH_S = 3, 6.0


@cache
def _pad(stated: str) -> PeerPad:
    """Return a scene as libuipc is given it, with the setting of our batches."""
    return peer_pad(within(stated_scene(json.loads(stated)), Manner().tolerance)[0])


def press_in_libuipc(
    stated: str, count: int, tolerance: str, *, folder: str, backend: str = "cuda"
) -> tuple[ScenePress, str]:
    """Press every environment along its trajectory: one press to warm up, then the timed ones.

    Between presses the indenters are lifted off; the gel then comes back to rest.

    Args:
        stated: The scene's options as JSON.
        folder: Where libuipc may write.
        backend: ``none`` takes the scene and computes nothing.

    Returns:
        The press, and what did not work, in words.

    Raises:
        RigError: libuipc cannot do this scene, or has met an error.
    """
    presses = PeerPresses(_pad(stated), count)
    started = time.perf_counter()
    world = PeerWorld(presses, tolerance, folder=folder, backend=backend)
    try:
        frames = [world.checked(poses) for poses in presses.poses]
        set_up_s = time.perf_counter() - started
        times: list[tuple[float, float]] = []
        while len(times) < _PRESSES and sum(wall for wall, _ in times) < _ENOUGH_S:
            times.append(world.timed())
        positions, tips_m = world.read()
        problems = _limits(frames)
        if not presses.pad.model.contact_options.friction:
            # Where nothing moves, with one step only, the gradient is that of the frame before.
            # What rubs would be let go there.
            world.go_to(presses.poses[-1])
            world.world.sync()
            still = int(world.frame_facts().get(_NEWTON, 0))
            if still > 1:
                problems.append(f"the frame that stands still took {still} Newton steps")
        press = presses.judged(
            positions,
            world.contact_forces(),
            preset=tolerance,
            setup_s=set_up_s,
            wall_s=min(times)[0],
            cpu_s=min(times)[1],
            iterations=sum(int(frame.get(_NEWTON, 0)) for frame in frames),
        )
        return press, "; ".join([*problems, *presses.strayed(tips_m)])
    finally:
        world.close()


def _limits(frames: Sequence[dict[str, Any]]) -> list[str]:
    """Say in how many frames an iteration ended at its limit."""
    hits = {what: sum(int(f.get(name, 0)) for f in frames) for name, what in _LIMITS.items()}
    return [
        f"{hit} of {len(frames)} frames ended {what} at its limit"
        for what, hit in hits.items()
        if hit
    ]


class PeerWorld:
    """A scene that libuipc has taken."""

    def __init__(self, presses: PeerPresses, tolerance: str, *, folder: str, backend: str) -> None:
        self.uipc = importlib.import_module("uipc")
        self._parts = {
            name: importlib.import_module(f"uipc.{name}")
            for name in ("geometry", "constitution", "core")
        }
        self.uipc.Logger.set_level(self.uipc.Logger.Level.Error)
        self.uipc.Timer.disable_all()
        self.presses, self.model = presses, presses.pad.model
        self.aims = presses.start  # where the next frame goes, in the pads' frames
        scene = self.uipc.Scene(self._settings(tolerance))
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

    def go_to(self, poses: FloatArray) -> None:
        """Compute one frame: the indenters go to these poses, shape [count, 4, 4]."""
        self.aims = poses
        self.world.advance()

    def checked(self, poses: FloatArray) -> dict[str, Any]:
        """Compute a frame, and return what libuipc says of it."""
        self.go_to(poses)
        self._check()
        return self.frame_facts()

    def timed(self) -> tuple[float, float]:
        """Lift off, and return the time of a press, of the wall and of the processor [s].

        Indenters go back the way that they came; the second frame at first touch lets gel rest.
        """
        poses, start = self.presses.poses, self.presses.start
        for pose in (*poses[-1 - _LIFT_STRIDE :: -_LIFT_STRIDE], start, start):
            self.go_to(pose)
        self.world.sync()
        wall, cpu = time.perf_counter(), time.process_time()
        for pose in poses:
            self.go_to(pose)
        self.world.sync()
        found = time.perf_counter() - wall, time.process_time() - cpu
        self._check()
        return found

    def _check(self) -> None:
        if not self.world.is_valid():
            raise ConvergenceError(
                f"libuipc has met an error in frame {self.world.frame()}",
                remedy="see its own messages above",
            )

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
        count, origins = self.presses.count, self.presses.origins_m
        gel, body = (slot.geometry() for slot in self._slots)
        nodes = np.array(self.uipc.view(gel.positions())).reshape(count, -1, 3)
        transforms = np.array(self.uipc.view(body.transforms()))
        tips = transforms.reshape(count, 4, 4)[:, :3, 3]
        return nodes - origins[:, None], tips - origins

    def contact_forces(self) -> FloatArray | None:
        """Return the force on every node [N], [count, node_count, 3]; None if there is no way.

        libuipc keeps the gradient of its last assembly, that of energy times the square of a
        frame's time, at the positions from which the last Newton step started.
        """
        feature = self.world.features().find(self._parts["core"].ContactSystemFeature)
        if feature is None:
            return None
        count, node_count = self.presses.count, len(self.model.nodes)
        found = np.zeros((count * node_count, 3))
        # The number that libuipc gives the gel's first vertex among all.
        offset = self._slots[0].geometry().meta().find(self.uipc.builtin.global_vertex_offset)
        first = 0 if offset is None else int(np.array(offset.view()).reshape(-1)[0])
        for kind in feature.contact_primitive_types():
            pairs = self._parts["geometry"].Geometry()
            feature.contact_gradient(kind, pairs)
            vertices, gradients = (pairs.instances().find(name) for name in ("i", "grad"))
            if vertices is None or gradients is None:
                continue
            at = np.array(vertices.view()).reshape(-1) - first
            on_gel = (at >= 0) & (at < len(found))
            forces = -np.array(gradients.view()).reshape(-1, 3) / FRAME_S**2
            np.add.at(found, at[on_gel], forces[on_gel])
        return found.reshape(count, node_count, 3)

    def _settings(self, tolerance: str) -> dict[str, Any]:
        settings, options = self.uipc.Scene.default_config(), self.model.contact_options
        _merge(
            settings,
            {
                "dt": FRAME_S,
                "gravity": [[0.0], [0.0], [0.0]],
                "contact": {
                    "d_hat": options.distance_m,
                    "eps_velocity": options.slip_m / FRAME_S,
                    "friction": {"enable": int(options.friction > 0.0)},
                },
                "sanity_check": {"mode": "quiet"},
            },
        )
        _merge(settings, SETTINGS[tolerance])
        return dict(settings)

    def _gel(self) -> Any:
        presses, view = self.presses, self.uipc.view
        geometry, constitution = self._parts["geometry"], self._parts["constitution"]
        rest, count = self.model.nodes, presses.count
        nodes = (rest + presses.origins_m[:, None]).reshape(-1, 3)
        step = len(rest) * np.arange(count)
        tets = (self.model.elements + step[:, None, None]).reshape(-1, 4)
        gel = geometry.tetmesh(nodes, np.ascontiguousarray(tets, dtype=np.int32))
        geometry.label_surface(gel)
        geometry.label_triangle_orient(gel)
        moduli = constitution.ElasticModuli.lame(presses.bulk_pa[0, 0], presses.shear_pa[0, 0])
        constitution.StableNeoHookean().apply_to(gel, moduli, _GEL_KG_M3)
        # It names the law's two constants as Lame's, which they are not, and keeps them by element.
        for name, values in (("mu", presses.shear_pa), ("lambda", presses.bulk_pa)):
            view(gel.tetrahedra().find(name))[:] = values.reshape(-1)
        fixed = view(gel.vertices().find(self.uipc.builtin.is_fixed))
        fixed[:] = np.tile(self.model.clamped, count).astype(fixed.dtype)
        view(gel.vertices().find(self.uipc.builtin.is_dynamic))[:] = 0
        return gel

    def _bodies(self) -> Any:
        presses, view = self.presses, self.uipc.view
        geometry, constitution = self._parts["geometry"], self._parts["constitution"]
        # It reads memory as it lies.
        faces = np.ascontiguousarray(presses.pad.body.faces, dtype=np.int32)
        body = geometry.trimesh(np.ascontiguousarray(presses.pad.body.vertices), faces)
        geometry.label_surface(body)
        constitution.AffineBodyConstitution().apply_to(body, _RIGID_PA, _STEEL_KG_M3)
        mass_kg = _STEEL_KG_M3 * float(body.meta().find("volume").view()[0])
        strength = _DRIVE_N_M * FRAME_S**2 / mass_kg
        constitution.SoftTransformConstraint().apply_to(body, np.array([strength, strength]))
        body.instances().resize(presses.count)
        view(body.instances().find(self.uipc.builtin.is_dynamic))[:] = 0
        view(body.transforms())[:] = self._placed(presses.start)
        return body

    def _placed(self, poses: FloatArray) -> FloatArray:
        """Return poses in the pads' frames in that of the scene, shape [count, 4, 4]."""
        found = poses.copy()
        found[:, :3, 3] += self.presses.origins_m
        return found

    def _contact(self, scene: Any, gel: Any, body: Any) -> None:
        table = scene.contact_tabular()
        friction, resistance = self.model.contact_options.friction, self.presses.pad.resistance
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
