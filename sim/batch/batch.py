"""A batch of presses: many environments over one pad and one indenter, in step with each other.

Each has a material, a friction, a place and a trajectory of its own. They descend to equilibrium as
a single press does (``sim.solve.descents``), with inverses of the stiffness that a pilot press left
(``sim.batch.inverses``); the one nearest to where the environments are serves them all. Arrays stay
on the device. On a GPU a step is one CUDA graph with a loop in it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.batch.environment import (
    BatchOptions,
    BatchResult,
    Environment,
    Trajectory,
    goals_of,
    refuse_unfit,
)
from sim.batch.inverses import inverses_for
from sim.batch.pilot import Pilot
from sim.batch.steps import StepArrays, Steps
from sim.device import Device, on_host
from sim.fields.stress import StressProjection
from sim.material.elastic_body import element_constants
from sim.solve.descent_state import Status
from sim.solve.descents import Descents
from sim.solve.equilibrium import EXTENSIONS
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# A residual that is always enough, over E H^2 with the pad's height H.
_FLOOR_SHARE = 1e-9
# Steps that an environment remembers: twice as many save no evaluation under an inverse that was
# made so near, and are read anew in every step.
_REMEMBERED = 8


class Batch:
    """Environments over one pad, ready to be pressed again and again.

    Args:
        pilot: Pad, indenter and inverses.

    Attributes:
        model: The pad, on the device.
        positions: Nodes of every environment [m], a Warp array of vectors, shape
            [environment_count, node_count]; PyTorch and JAX take it through DLPack.
        stress: Finds the stress on the surface, on the device.

    Raises:
        ConfigError: The environments do not fit together or to the pilot.
    """

    def __init__(
        self,
        pilot: Pilot,
        environments: Sequence[Environment],
        *,
        options: BatchOptions | None = None,
        device: str = "cpu",
    ) -> None:
        refuse_unfit(pilot.model, environments)
        self.pilot, self.options = pilot, options or BatchOptions()
        self.environments, self.count = list(environments), len(environments)
        self.device, self._device = device, Device(device)
        self.model = model = pilot.model.on(device)
        gel, surface, young_pa = self._own_materials()
        young_shares = model.young_pa / young_pa
        self.inverse = inverses_for(pilot, self._device, count=self.count)
        self.descents = Descents(
            model,
            pilot.indenter,
            self.inverse,
            count=self.count,
            gel=gel,
            surface=surface,
            memory=_REMEMBERED,
            young_share=young_shares,
            keeps=True,
        )
        floor_n = _FLOOR_SHARE * model.young_pa * model.height_m**2
        self.descents.set(
            relative=self.options.residual_relative,
            floor=floor_n,
            steps_max=self.options.steps_max,
            rounding=model.gel.rounding_n,
            pushed=int(pilot.is_pushed),
            touches=1,
        )
        self._arrays = StepArrays(
            pilot, self.environments, self.descents, self.inverse, young_shares, floor_n=floor_n
        )
        self._active, self._straight = self._arrays.history.active, self._arrays.straight
        self.positions = self._arrays.history.last
        self.stress = StressProjection(model, self.positions, gel=gel)
        self._steps: dict[int, Steps] = {}
        # Where the environments are, as ``goals_of`` has it, and their forms of the barrier.
        self._at = np.zeros((self.count, 4))
        self._extension = np.zeros(self.count, dtype=np.intp)
        self.reset()

    def reset(self, which: Sequence[int] | None = None) -> None:
        """Put environments back to the untouched gel; None is all of them."""
        chosen = np.arange(self.count) if which is None else np.asarray(which, dtype=np.intp)
        arrays, history, model = self._arrays, self._arrays.history, self.pilot.model
        for b in chosen:
            state = model.rest_state(tip=arrays.tips_m[b], rotation=arrays.rotations[b])
            self.descents.place(int(b), state, grip_start=state.grip)
        for array, value in (
            (history.coordinates, np.zeros((2, 4))),
            (history.heights, arrays.tips_m[chosen, 2:]),
            (history.last, model.nodes),
            (history.older, model.nodes),
        ):
            self._assign(array, chosen, value)
        self._extend(chosen, np.zeros(len(chosen), dtype=np.intp))
        self._at[chosen] = 0.0

    def step(
        self,
        *,
        depths_m: FloatArray | None = None,
        loads_n: FloatArray | None = None,
        shifts_m: FloatArray | None = None,
        turns_rad: FloatArray | None = None,
        active: NDArray[np.bool_] | None = None,
    ) -> NDArray[np.bool_]:
        """Take the environments' indenters somewhere and find the gel's equilibrium.

        Args:
            depths_m: Below first touch [m], shape [environment_count]; or
            loads_n: F_z that pushes them [N], the same shape, for a pilot that is pushed.
            shifts_m: Along x and y from where they came down [m], shape [environment_count, 2].
            turns_rad: About z through the tip [rad], shape [environment_count].
            active: Which take part; None is all of them. The others stay as they are.

        Returns:
            Which of those that took part arrived; the others are as far as they came.

        Raises:
            ConfigError: Depths are given where the pilot is pushed, or loads where it is not.
        """
        given = loads_n if self.pilot.is_pushed else depths_m
        if given is None:
            wanted = "loads_n" if self.pilot.is_pushed else "depths_m"
            raise ConfigError(f"the pilot is made for {wanted}", remedy=f"give {wanted}")
        goal = goals_of(given, shifts_m, turns_rad)
        taking = np.ones(self.count, dtype=np.bool_) if active is None else active
        return self._go(goal, taking)

    def _go(self, goal: FloatArray, taking: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Go somewhere, in parts if need be, and return who arrived."""
        arrived = self._attempt(goal, taking)
        parts = 2
        while parts <= self.options.parts_max and (taking & ~arrived).any():
            arrived |= self._in_parts(goal, taking & ~arrived, parts)
            parts *= 2
        self._at[arrived] = goal[arrived]
        return arrived

    def press(self, trajectories: Sequence[Trajectory] | Trajectory) -> BatchResult:
        """Press every environment along its trajectory from the untouched gel.

        Raises:
            ConfigError: There is not a trajectory for each, or they are unlike in length.
        """
        if isinstance(trajectories, Trajectory):
            trajectories = [trajectories] * self.count
        steps = self.prepare(self._checked(trajectories))
        goals = np.stack([each.goals for each in trajectories], axis=1)
        self.reset()
        steps.goals.assign(goals)
        evaluations = self.descents.state.evaluations
        before = on_host(evaluations).copy()
        self._active.fill_(1)
        steps.begin()
        self._device.synchronise()
        started, frame_count = time.perf_counter(), len(goals)
        for until in [frame_count] if steps.paced else range(1, frame_count + 1):
            steps.run(until)
        self._device.synchronise()
        results = steps.results()
        for frame in range(frame_count) if (results["status"] != Status.DONE).any() else ():
            self._go_on(frame, goals, results)
        wall_s = time.perf_counter() - started
        whole = (results["status"] == Status.DONE).all(axis=0)
        self._at[whole] = goals[-1, whole]
        return self._result(results, wall_s, (on_host(evaluations) - before).astype(np.int32))

    def prepare(self, frame_count: int = 1) -> Steps:
        """Compile the kernels and, on a GPU, record a step, so that ``press`` need not."""
        if frame_count not in self._steps:
            self._active.fill_(0)
            self._steps[frame_count] = Steps(self._arrays, frame_count)
        return self._steps[frame_count]

    def _go_on(self, frame: int, goals: FloatArray, results: dict[str, FloatArray]) -> None:
        """Take those further with care that did not arrive in a frame, or in one before it."""
        missed = results["status"][frame] != Status.DONE
        ready = missed & ((results["status"][:frame] == Status.DONE).all(axis=0))
        if not ready.any():
            return
        self._at[ready] = goals[frame - 1, ready] if frame else 0.0
        arrived = self._go(goals[frame], ready)
        for name, values in self.prepare(1).results().items():
            results[name][frame, arrived] = values[0, arrived]
        # Who arrived first sat idle while the others went on in parts.
        results["status"][frame, arrived] = Status.DONE

    def watch(self, launch: Callable[[], object]) -> None:
        """Have something launched at the end of every step: stress, images, a caller's kernel.

        It becomes part of the step's CUDA graph, so that it must not wait for the device.
        """
        launch()  # compiles its kernels, which a graph cannot
        self._arrays.watchers.append(launch)
        self._steps.clear()

    @property
    def poses(self) -> Any:
        """The indenters' poses now: Warp arrays ``tips`` [m] and ``rotations``."""
        return self.descents.poses

    def _own_materials(self) -> tuple[Any, Any, FloatArray]:
        """Return the environments' elements and surface, and E of what is touched of each [Pa]."""
        model, mesh = self.model, self.model.mesh
        own = [
            model.materials if each.materials is None else element_constants(mesh, each.materials)
            for each in self.environments
        ]
        touched = model.discretisation.touched_element
        young_pa = np.array([young[touched] for young, _ in own])
        usual = model.contact_options.friction
        friction = [usual if each.friction is None else each.friction for each in self.environments]
        return model.gel.of(own), model.surface.of(young_pa.tolist(), friction), young_pa

    def _attempt(self, goal: FloatArray, taking: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Go to a goal in one step, and return who arrived."""
        step = self.prepare(1)
        step.goals.assign(goal[None])
        arrived = np.zeros(self.count, dtype=np.bool_)
        while taking.any():
            self._active.assign(taking.astype(np.int32))
            step.begin()
            step.run(1)
            status = on_host(self.descents.state.status)
            arrived |= taking & (status == Status.DONE)
            near = taking & (status == Status.TOO_NEAR)
            taking = near & (self._extension + 1 < len(self._extensions))
            self._extend(np.flatnonzero(taking), self._extension[taking] + 1)
        return arrived

    def _in_parts(
        self, goal: FloatArray, failing: NDArray[np.bool_], parts: int
    ) -> NDArray[np.bool_]:
        """Go to a goal in so many steps, and return who arrived."""
        begun = self._at.copy()
        for part in range(1, parts + 1):
            self._straight.fill_(1 if part == 1 else 0)
            there = begun + part / parts * (goal - begun)
            failing = self._attempt(there, failing)
            self._at[failing] = there[failing]
        self._straight.fill_(0)
        return failing

    @property
    def _extensions(self) -> tuple[float, ...]:
        return (self.model.contact_options.extension, *EXTENSIONS)

    def _extend(self, which: NDArray[np.intp], stage: NDArray[np.intp]) -> None:
        """Give environments another form of the barrier."""
        self._extension[which] = stage
        chosen = np.array(self._extensions)[self._extension]
        least = [self.model.contact_options.gap_least_m(float(each)) for each in chosen]
        self.descents.surface.extensions.assign(chosen)
        self.descents.state.gap_least.assign(np.array(least))

    def _checked(self, trajectories: Sequence[Trajectory]) -> int:
        """Return the number of frames of trajectories that fit together.

        Raises:
            ConfigError: They do not.
        """
        lengths = {each.frame_count for each in trajectories}
        if len(trajectories) != self.count or len(lengths) != 1:
            raise ConfigError(
                f"{len(trajectories)} trajectories of {', '.join(map(str, sorted(lengths)))} "
                f"frames for {self.count} environments",
                remedy="give each environment a trajectory, all with the same number of frames",
            )
        for number, each in enumerate(trajectories):
            if each.is_pushed != self.pilot.is_pushed:
                given, wanted = ("loads", "depths")[:: 1 if each.is_pushed else -1]
                raise ConfigError(
                    f"environment {number} has {given}, and the pilot is made for {wanted}",
                    remedy=f"give {wanted}, or make a pilot for {given}",
                )
        return lengths.pop()

    def _result(
        self, results: dict[str, Any], wall_s: float, evaluations: NDArray[np.int32]
    ) -> BatchResult:
        symmetry, missed = self.model.mesh.symmetry, results["status"] != Status.DONE
        for name in ("push", "tips", "residual", "imbalance", "gap"):
            results[name][missed] = np.nan
        part = results["push"]
        return BatchResult(
            force_n=np.sum([sign * part for sign in symmetry.signs()], axis=0),
            depth_m=self._arrays.tips_m[:, 2] - results["tips"][..., 2],
            residual=results["residual"],
            imbalance=results["imbalance"],
            gap_m=results["gap"],
            evaluations=evaluations,
            wall_s=wall_s,
        )

    def _assign(self, array: Any, which: NDArray[np.intp], values: Any) -> None:
        """Set an array's entries of some environments."""
        host = array.numpy()
        host[which] = values
        if self._device.is_gpu:
            array.assign(host)
