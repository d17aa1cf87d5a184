"""A batch of presses: many environments over one pad and one indenter, in step with each other.

Each has a material, a friction, a place and a course of its own. They descend to equilibrium as a
single press does (``sim.solve.descents``), with inverses of the stiffness that a pilot press left
(``sim.batch.inverses``); the one nearest to where the environments are serves them all. Arrays stay
on the device. On a GPU a step is one CUDA graph with a loop in it: the host waits for its end and
reads how every environment ended.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.batch import step_kernels as kernels
from sim.batch.environment import (
    BatchOptions,
    BatchResult,
    Course,
    Environment,
    goals_of,
    refuse_unfit,
)
from sim.batch.frames import Frames
from sim.batch.inverses import inverses_for
from sim.batch.pilot import Pilot
from sim.batch.pilots_way import Guide, Stand
from sim.device import Device, filled, on_host
from sim.fields.stress import StressProjection
from sim.material.elastic_body import element_constants
from sim.solve.descent_state import Status
from sim.solve.descents import Descents
from sim.solve.equilibrium import EXTENSIONS
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# How far apart the inverses may be that serve at once: reading them takes a GPU most of a step.
_AHEAD = 1
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
        self._gel, surface, young_pa = self._own_materials()
        self._young_shares = model.young_pa / young_pa
        self.inverse = inverses_for(pilot, self._device, count=self.count)
        self.descents = Descents(
            model,
            pilot.indenter,
            self.inverse,
            count=self.count,
            gel=self._gel,
            surface=surface,
            memory=_REMEMBERED,
            young_share=self._young_shares,
            keeps=True,
        )
        self._tips_m, self._rotations = pilot.starts(self.environments)
        self._allocate()
        self.positions = self.trail.last
        self.stress = StressProjection(model, self.positions, gel=self._gel)
        self._frames: dict[int, Frames] = {}
        self.watchers: list[Callable[[], object]] = []
        self.reset()

    def reset(self, which: Sequence[int] | None = None) -> None:
        """Put environments back to the untouched gel; None is all of them."""
        chosen = np.arange(self.count) if which is None else np.asarray(which, dtype=np.intp)
        trail, model = self.trail, self.pilot.model
        for b in chosen:
            state = model.rest_state(tip=self._tips_m[b], rotation=self._rotations[b])
            self.descents.place(int(b), state, grip_start=state.grip)
        for array, value in (
            (trail.features, np.zeros((2, 4))),
            (trail.heights, self._tips_m[chosen, 2:]),
            (trail.last, model.nodes),
            (trail.older, model.nodes),
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

    def press(self, courses: Sequence[Course] | Course) -> BatchResult:
        """Press every environment along its course from the untouched gel.

        Raises:
            ConfigError: There is not a course for each, or they are unlike in length.
        """
        courses = [courses] * self.count if isinstance(courses, Course) else list(courses)
        frames = self.prepare(self._checked(courses))
        course = np.stack([each.goals for each in courses], axis=1)
        self.reset()
        frames.course.assign(course)
        evaluations = self.descents.state.evaluations
        before = on_host(evaluations).copy()
        self._active.fill_(1)
        frames.begin()
        self._device.synchronise()
        started = time.perf_counter()
        whole_way = len(course)
        for until in [whole_way] if frames.paced else range(1, whole_way + 1):
            frames.run(until)
        self._device.synchronise()
        results = frames.results()
        for frame in range(len(course)) if (results["status"] != Status.DONE).any() else ():
            self._go_on(frame, course, results)
        wall_s = time.perf_counter() - started
        whole = (results["status"] == Status.DONE).all(axis=0)
        self._at[whole] = course[-1, whole]
        return self._result(results, wall_s, (on_host(evaluations) - before).astype(np.int32))

    def prepare(self, frame_count: int = 1) -> Frames:
        """Compile the kernels and, on a GPU, record a step, so that ``press`` need not."""
        if frame_count not in self._frames:
            self._active.fill_(0)
            self._frames[frame_count] = Frames(self, frame_count)
        return self._frames[frame_count]

    def _go_on(self, frame: int, course: FloatArray, results: dict[str, FloatArray]) -> None:
        """Take those further with care that did not arrive in a frame, or in one before it."""
        missed = results["status"][frame] != Status.DONE
        ready = missed & ((results["status"][:frame] == Status.DONE).all(axis=0))
        if not ready.any():
            return
        self._at[ready] = course[frame - 1, ready] if frame else 0.0
        arrived = self._go(course[frame], ready)
        for name, values in self.prepare(1).results().items():
            results[name][frame, arrived] = values[0, arrived]
        # Who arrived first sat idle while the others went on in parts.
        results["status"][frame, arrived] = Status.DONE

    def watch(self, launch: Callable[[], object]) -> None:
        """Have something launched at the end of every step: stress, images, a caller's kernel.

        It becomes part of the step's CUDA graph, so that it must not wait for the device.
        """
        launch()  # compiles its kernels, which a graph cannot
        self.watchers.append(launch)
        self._frames.clear()

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

    def _allocate(self) -> None:
        device, count, model = self._device, self.count, self.model
        shape = dict.fromkeys(("features", "heights"), (count, 2))
        shape |= dict.fromkeys(("last", "older"), (count, len(model.nodes)))
        self.trail = device.zeroed(kernels.Trail, (count,), **shape)
        self._active = self.trail.active
        self.straight = device.zeros(1, wp.int32)
        states, inverse = self.pilot.states, self.inverse
        self.together = device.zeroed(
            kernels.Together,
            (count,),
            counts=(len(states),),
            first=(len(states),),
            blocks=inverse.blocks.shape,
        )
        for name in ("blocks", "width"):
            setattr(self.together, name, getattr(inverse, name))
        self.together.ahead = _AHEAD
        inverse.which = self.together.which
        way, nodes = self.pilot.way, model.nodes
        self.guide = device.tables(
            Guide,
            {
                "stands": np.concatenate([np.zeros((1, 4)), self.pilot.stands_m]),
                "motions": np.stack([nodes, *(each.point.state.positions for each in way)]) - nodes,
                "depths": np.array([0.0, *(each.point.depth_m for each in way)]),
                "states": np.array([-1, *(each.state for each in way)]),
                "before": np.array([0, *(each.before for each in way)]),
                "frames": np.array([each.frame for each in states]),
            },
        )
        self.floor_n = _FLOOR_SHARE * model.young_pa * model.height_m**2
        self._at = np.zeros((count, 4))
        self._extension = np.zeros(count, dtype=np.intp)
        self.descents.set(
            relative=self.options.residual_relative,
            floor=self.floor_n,
            steps_max=self.options.steps_max,
            rounding=model.gel.rounding_n,
            pushed=int(self.pilot.is_pushed),
            touches=1,
        )

    def _attempt(self, goal: FloatArray, taking: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Go to a goal in one step, and return who arrived."""
        frames = self.prepare(1)
        frames.course.assign(goal[None])
        arrived = np.zeros(self.count, dtype=np.bool_)
        while taking.any():
            self._active.assign(taking.astype(np.int32))
            frames.begin()
            frames.run(1)
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
            self.straight.fill_(1 if part == 1 else 0)
            there = begun + part / parts * (goal - begun)
            failing = self._attempt(there, failing)
            self._at[failing] = there[failing]
        self.straight.fill_(0)
        return failing

    def way(self, course: Any, until: Any) -> Any:
        """Return where the environments begin, and where a course leads them."""
        symmetry, device = self.model.mesh.symmetry, self._device
        metres_n, metres_rad = self.pilot.metres
        return filled(
            kernels.Way,
            tips=device.array(self._tips_m, wp.vec3d),
            rotations=device.array(self._rotations, wp.mat33d),
            course=course,
            until=until,
            metres=wp.vec2d(metres_n, metres_rad),
            copies=float(symmetry.copies),
            pushed=self.pilot.is_pushed,
            shares=device.array(self._young_shares, wp.float64),
            guided=device.array([int(each.is_guided) for each in self.environments], wp.int32),
            stands=device.zeros(course.shape, Stand),
            goals=device.zeros(course.shape, Stand),
            nearest=device.zeros(course.shape, wp.int32),
        )

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

    def _checked(self, courses: Sequence[Course]) -> int:
        """Return the frames of courses that fit together.

        Raises:
            ConfigError: They do not.
        """
        lengths = {each.frame_count for each in courses}
        if len(courses) != self.count or len(lengths) != 1:
            raise ConfigError(
                f"{len(courses)} courses of {', '.join(map(str, sorted(lengths)))} frames for "
                f"{self.count} environments",
                remedy="give each environment a course, all with the same number of frames",
            )
        for number, each in enumerate(courses):
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
            depth_m=self._tips_m[:, 2] - results["tips"][..., 2],
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
