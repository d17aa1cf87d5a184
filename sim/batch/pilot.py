"""What a batch's presses share: the pad, and a pilot press whose stiffness serves them all."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim.arrays import FloatArray
from sim.batch.environment import Course, Environment
from sim.effects.plan import plan_effects
from sim.effects.presets import BATCH, build_model, mesh_for
from sim.scene.indenter import Indenter
from sim.scene.scene import Effect, Scene
from sim.solve.equilibrium import SolverOptions
from sim.solve.load_steps.equilibrium import PathPoint
from sim.solve.load_steps.first_touch import touch_height
from sim.solve.load_steps.path import Hold, LoadingPath
from sim.solve.model import Model
from tacauchy_rig.errors import ConfigError

# A barrier of 1 % of the height makes F_z 1 % too large and halves the steps.
BARRIER_SHARE = 0.01
# What only preconditions need not be in balance more exactly.
_RESIDUAL = 1e-4


def batch_model(scene: Scene, *, refinement: float = 1.0, symmetric: bool = True) -> Model:
    """Mesh a scene's pad for a batch, on the CPU.

    Args:
        scene: Pad, gel and indenter; its target and its barrier do not matter.
        symmetric: Model a part where symmetry allows. No environment can then move or tilt the
            indenter.

    Raises:
        ConfigError: The pad cannot be meshed for this indenter.
    """
    scene = replace(
        scene,
        barrier_m=BARRIER_SHARE * scene.pad.height_m,
        effects=((Effect.FINITE_STRAIN, True), (Effect.LOCKING_FREE_ELEMENT, True)),
    )
    mesh = mesh_for(scene, symmetric=symmetric, refinement=refinement, resolution=BATCH)
    return build_model(scene, plan=plan_effects(scene), mesh=mesh)


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotState:
    """One state, and its semidefinite stiffness [N/m].

    Attributes:
        data: CSR values of the upper triangle.
        border: Column of the indenter's height, shape [unknown_count].
        corner: Its diagonal entry.
        stand_m: Where on the course it is, as ``step_kernels`` has features [m], shape [4].
        motion_m: Of the nodes from the untouched gel [m], shape [node_count, 3].
        depth_m: Of the indenter [m].
    """

    data: FloatArray
    border: FloatArray
    corner: float
    stand_m: FloatArray
    motion_m: FloatArray
    depth_m: float


@dataclass(slots=True)
class Pilot:
    """The state at a few frames of one press, and its stiffness, contact included.

    Args:
        model: The pad, on the CPU.
        course: Where it goes; in frames between two that are kept it need not be.
        centre_m: Where it comes down, x and y [m].
        count: Frames whose state is kept, at most, evenly over the course.

    Attributes:
        touch_m: Height of the indenter's tip at first touch [m].
        metres: Depth for a newton [m/N], and way of a contact's edge for a radian [m].
        states: Of those frames.
        dense: Their inverses [m/N], shape [state_count, size, size], once a GPU has had them made.

    Raises:
        ConfigError: The model has what batches lack.
    """

    model: Model
    indenter: Indenter
    course: Course
    centre_m: tuple[float, float] = (0.0, 0.0)
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    count: int = 8
    touch_m: float = field(init=False)
    metres: tuple[float, float] = field(init=False)
    states: list[PilotState] = field(init=False)
    dense: NDArray[np.float32] | None = field(init=False, default=None, repr=False)
    setup_s: float = field(init=False)

    def __post_init__(self) -> None:
        if self.model.relaxation is not None:
            raise ConfigError(
                "a batch does not know relaxation", remedy="leave it out, or press one by one"
            )
        started = time.perf_counter()
        path = LoadingPath(
            self.model,
            self.indenter,
            self.centre_m,
            rotation=self.rotation,
            options=SolverOptions(residual_relative=_RESIDUAL),
        )
        self.touch_m = path.touch_m
        points = list(self._points(path))
        deepest = points[-1][1]
        force = max(float(deepest.force_n[2]), 1e-300)
        self.metres = deepest.depth_m / force, deepest.contact_radius_m
        self.states = [self._state(frame, point) for frame, point in points]
        self.setup_s = time.perf_counter() - started

    @property
    def is_pushed(self) -> bool:
        """The indenter's height is an unknown, its force given."""
        return self.course.is_pushed

    def starts(self, environments: Sequence[Environment]) -> tuple[FloatArray, FloatArray]:
        """Return where environments' indenters first touch the pad.

        Returns:
            Tips [m], shape [environment_count, 3], and rotations to the pad's frame, [..., 3, 3].
        """
        tips, rotations = [], []
        for own in environments:
            rotation = self.rotation if own.rotation is None else own.rotation
            x, y = np.add(self.centre_m, own.offset_m).tolist()
            height = self.touch_m
            if not own.is_guided:
                nodes = self.model.nodes
                height = touch_height(
                    self.model, self.indenter, nodes, centre_m=(x, y), rotation=rotation
                )
            tips.append([x, y, height])
            rotations.append(rotation)
        return np.array(tips), np.array(rotations)

    def _points(self, path: LoadingPath) -> Iterator[tuple[int, PathPoint]]:
        """Go the course, and yield the frames that are kept."""
        course, frames = self.course, self.course.frame_count
        kept = np.unique(np.linspace(0, frames, self.count + 1).round().astype(int)[1:] - 1)
        before = np.zeros(4)
        for frame in kept[kept >= 0]:
            stand = course.goals[frame]
            if stand[0] != before[0]:
                go = path.push if self.is_pushed else path.advance
                point = go(float(stand[0]))
            if np.any(stand[1:] != before[1:]):
                x, y, turn = (float(each) for each in stand[1:] - before[1:])
                hold = Hold.FORCE if self.is_pushed else Hold.DEPTH
                point = path.carry(shift_m=(x, y), twist_rad=turn, hold=hold)
            before = stand
            yield int(frame), point

    def _state(self, frame: int, point: PathPoint) -> PilotState:
        model, state = self.model, point.state
        contact = point.equilibrium.touch(curved=False)
        along, x, y, turn = self.course.goals[frame]
        along *= self.metres[0] if self.is_pushed else 1.0
        return PilotState(
            data=model.hessian_data(state.positions, contact.stiffness, projected=True),
            border=model.pattern.unknowns(model.surface.scatter(-contact.stiffness[..., 2])),
            corner=float(contact.stiffness[..., 2, 2].sum()),
            stand_m=np.array([x, y, along, turn * self.metres[1]]),
            motion_m=state.positions - model.nodes,
            depth_m=point.depth_m,
        )
