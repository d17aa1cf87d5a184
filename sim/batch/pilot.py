"""What a batch's presses share: the pad, and a pilot press whose stiffness serves them all."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim.batch.environment import Environment, Trajectory
from sim.effects.plan import plan_effects
from sim.effects.presets import BATCH, build_model, mesh_for
from sim.scene.indenter import Indenter
from sim.scene.scene import Effect, Scene
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import Hold, LoadingPath, touch_height
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# A barrier of 1 % of the height makes F_z 1 % too large and halves the steps.
BARRIER_SHARE = 0.01
# What only preconditions need not be in balance more exactly.
_RESIDUAL = 1e-4
# Points from one kept state to the next. Environments start on the straight lines
# between them, and what those are off by costs evaluations.
_POINTS_PER_STATE = 4


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
class PilotPoint:
    """A point of the pilot's path.

    Attributes:
        before: Number of the point before it, the first is 1; 0 for the untouched gel.
        goal: What it went to, as ``goals_of`` has it, shape [4].
        point: What it found.
        state: The one that is kept there, or -1.
    """

    before: int
    goal: FloatArray
    point: PathPoint
    state: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotState:
    """The semidefinite stiffness of one state [N/m].

    Attributes:
        data: CSR values of the upper triangle.
        border: Column of the indenter's height, shape [unknown_count].
        corner: Its diagonal entry.
        frame: Its number among the trajectory's.
    """

    data: FloatArray
    border: FloatArray
    corner: float
    frame: int


@dataclass(slots=True)
class Pilot:
    """The state at a few frames of one press, and its stiffness, contact included.

    Args:
        model: The pad, on the CPU.
        trajectory: Where the indenter goes.
        centre_m: Where it comes down, x and y [m].
        count: Frames whose state is kept, at most, evenly over the trajectory.
        shares: Of depth or force, at which what moves along the surface does so once more: who is
            pressed less hard slides sooner, and wants other inverses.

    Attributes:
        touch_m: Height of the indenter's tip at first touch [m].
        metres: Depth for a newton [m/N], and distance of a contact's edge for a radian [m].
        points: Its path.
        states: Of those frames.
        dense: Their inverses [m/N], shape [size, size] each, once a GPU has had them made.

    Raises:
        ConfigError: The model has what batches lack, or a share is none.
    """

    model: Model
    indenter: Indenter
    trajectory: Trajectory
    centre_m: tuple[float, float] = (0.0, 0.0)
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    count: int = 8
    shares: Sequence[float] = ()
    touch_m: float = field(init=False)
    metres: tuple[float, float] = field(init=False)
    points: list[PilotPoint] = field(init=False)
    states: list[PilotState] = field(init=False)
    dense: list[NDArray[np.float32]] | None = field(init=False, default=None, repr=False)
    setup_s: float = field(init=False)

    def __post_init__(self) -> None:
        if self.model.relaxation is not None:
            raise ConfigError(
                "a batch does not know relaxation", remedy="leave it out, or press one by one"
            )
        if not all(0.0 < share < 1.0 for share in self.shares):
            raise ConfigError(f"shares {self.shares}", remedy="give shares between 0 and 1")
        started = time.perf_counter()
        path = LoadingPath(
            self.model,
            self.indenter,
            self.centre_m,
            rotation=self.rotation,
            options=SolverOptions(residual_relative=_RESIDUAL),
        )
        self.touch_m = path.touch_m
        self.points, self.states = [], []
        goals = self._goals()
        self._travel(path, goals)
        deepest = self.points[len(goals) - 1].point
        force = max(float(deepest.force_n[2]), 1e-300)
        self.metres = deepest.depth_m / force, deepest.contact_radius_m
        self.setup_s = time.perf_counter() - started

    @property
    def is_pushed(self) -> bool:
        """The indenter's height is an unknown, its force given."""
        return self.trajectory.is_pushed

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

    @property
    def coordinates_m(self) -> FloatArray:
        """Coordinates of its points, as ``step_kernels`` has them, shape [n, 4]."""
        along, x, y, turn = np.array([each.goal for each in self.points]).T
        metres = self.metres[0] if self.is_pushed else 1.0
        return np.column_stack([x, y, metres * along, self.metres[1] * turn])

    def _goals(self) -> FloatArray:
        """Return where to go on the trajectory, some points for every state that is kept."""
        trajectory, frames = self.trajectory, self.trajectory.frame_count
        kept = np.unique(np.linspace(0, frames, self.count + 1).round())
        parts = np.linspace(0.0, len(kept) - 1.0, _POINTS_PER_STATE * (len(kept) - 1) + 1)[1:]
        times = np.interp(parts, np.arange(len(kept)), kept)
        goals = np.concatenate([np.zeros((1, 4)), trajectory.goals]).T
        return np.column_stack([np.interp(times, np.arange(frames + 1), goal) for goal in goals])

    def _legs(self, goals: FloatArray) -> Iterator[tuple[int, FloatArray, int]]:
        """Yield the points to come from, goals, and the number of each among the trajectory's."""
        yield from ((number, goal, number) for number, goal in enumerate(goals))
        moving, count = int(np.argmax(goals[:, 1:].any(axis=1))), len(goals)
        for share in self.shares if moving else ():
            less = goals[moving - 1 :] * [share, 1.0, 1.0, 1.0]
            # From the last point that is pressed less; where it branches no state is kept.
            yield max(1, int(np.searchsorted(goals[:moving, 0], less[0, 0]))), less[0], 0
            for number, goal in enumerate(less[1:], start=moving):
                count += 1
                yield count, goal, number
            count += 1

    def _travel(self, path: LoadingPath, goals: FloatArray) -> None:
        """Go to one point after the other, and note each."""
        for before, goal, number in self._legs(goals):
            begun = self.points[before - 1] if before else None
            origin, point = (begun.goal, begun.point) if begun else (np.zeros(4), None)
            if point is None or goal[0] != origin[0]:
                go = path.push if self.is_pushed else path.advance
                point = go(float(goal[0]), start=point)
            if np.any(goal[1:] != origin[1:]):
                x, y, turn = (float(each) for each in goal[1:] - origin[1:])
                hold = Hold.FORCE if self.is_pushed else Hold.DEPTH
                point = path.carry(shift_m=(x, y), twist_rad=turn, hold=hold)
            is_kept = number % _POINTS_PER_STATE == _POINTS_PER_STATE - 1
            state = len(self.states) if is_kept else -1
            self.points.append(PilotPoint(before=before, goal=goal, point=point, state=state))
            if is_kept:
                self.states.append(self._state(point, frame=number // _POINTS_PER_STATE))

    def _state(self, point: PathPoint, *, frame: int) -> PilotState:
        model, state = self.model, point.state
        contact = point.equilibrium.touch(curved=False)
        return PilotState(
            data=model.hessian_data(state.positions, contact.stiffness, projected=True),
            border=model.pattern.unknowns(model.surface.scatter(-contact.stiffness[..., 2])),
            corner=float(contact.stiffness[..., 2, 2].sum()),
            frame=frame,
        )
