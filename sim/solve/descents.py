"""Descents to equilibrium of many environments at once, on their device.

They share a pad and an indenter; material, friction, pose and load are each one's own. Arrays stay
on the device; an environment runs until it is done or asks the host for something.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from sim.contact.barrier_and_friction_kernels import Pressed, Seen
from sim.contact.indenter_distance import body_of, poses_at
from sim.contact.surface_and_grip import ContactForces, Grip, State
from sim.device import Device, filled
from sim.scene.indenter import Indenter, IndenterSet, MeshIndenter
from sim.solve import descent_state as kernels
from sim.solve.descent_kernels import descent_kernels
from sim.solve.descent_state import Act, Mode, Status
from sim.solve.lbfgs_kernels import Memory
from sim.solve.model import Model
from sim.solve.refused_overlap import OVERLAP_SHARE
from sim.solve.weight_and_inertia import Potential, pull_of
from tacauchy_rig.core.arrays import FloatArray

# Of the pad's height: the longest step of an indenter that is pushed. A factor that hardly holds it
# would send it through the pad, where contact is no longer seen.
_TIP_STEP_SHARE = 0.025
# Of a block on a GPU, which has an environment: those that run longest are few, and wait for these.
_THREADS = 1024
# Steps after which lagged pressure may be left as it is, where the inverse can be made anew.
_HOLDS_UNTIL = 50
# Steps that are never taken, for patience that does not end.
_NEVER = 2**30


class Inverse(Protocol):
    """An approximate inverse of the stiffness.

    Attributes:
        kind: Warp type of what it takes.
        row_count: Rows of the vectors that it takes and gives, at least the unknowns and the tip.
        scaled: It wants what it takes in units of the residual.
        unit: What it gives must be multiplied with this.
        weights: What it takes and gives must be multiplied with these, shape [row_count].
        column_count: Vectors that it takes at once.
    """

    kind: Any
    row_count: int
    scaled: bool
    unit: float
    weights: Any
    column_count: int

    def apply(self, asked: Any, sources: Any, found: Any, prepare: Callable[[], None]) -> None:
        """Set ``found`` to the inverse times ``sources``, shape [column_count, row_count].

        ``asked`` names the environments that ask, for an inverse on the host; on a GPU it is None.
        ``prepare`` makes the sources; what does not need them may go beside it.
        """
        ...


class Descents:
    """The descents of some environments.

    Args:
        memory: Steps that are remembered, 32 at most.
        patience: After so many steps with a factor, it is asked for anew if the residual is still
            more than this share of the contact force.
        gel: Their elements, as ``ElasticBody.of`` gives them; None is the model's, of one.
        surface: What may be touched of them, as ``ContactSurface.of`` gives it, likewise.
        young_share: E that the inverse is of over theirs, shape [environment_count].
        keeps: The inverse is never made anew.

    Attributes:
        positions: Of the nodes [m], shape [environment_count, node_count].
        grip: What tangential contact remembers; ``grip_start`` from before the step.
        pressed: Surfaces, indenters, poses, grip and positions, as contact's kernels take them.
        threads: Of a block that has an environment.
        sources: What the inverse is asked for; ``found`` what it answers.
        ran: Whoever uses them has run all of its kernels, which a graph may hold from now on.
    """

    def __init__(
        self,
        model: Model,
        indenter: Indenter | IndenterSet,
        inverse: Inverse,
        *,
        potential: Potential | None = None,
        memory: int = 16,
        patience: Sequence[tuple[int, float]] = (),
        count: int = 1,
        gel: Any = None,
        surface: Any = None,
        young_share: FloatArray | None = None,
        keeps: bool = False,
    ) -> None:
        self.model, self._inverse, self.count = model, inverse, count
        self._device = device = Device(model.device)
        self._gel, self.indenter = gel, indenter
        self.threads = _THREADS if device.is_gpu else 1
        friction = model.contact_options.friction
        self.surface = surface or model.surface.of([model.young_pa], [friction])
        self.state = device.zeroed(kernels.Descent, (count,), residuals=(count, 6))
        self.state.slot.assign(np.arange(count, dtype=np.int32))
        # On the CPU these views share the device's memory, and are made once.
        names = () if device.is_gpu else vars(kernels.Descent)["vars"]
        self._views = {name: getattr(self.state, name).numpy() for name in names}
        self.ran = False
        rows, nodes = model.pattern.dof_count + 1, len(model.nodes)
        self._allocate(memory, rows)
        self.positions = device.zeros((count, nodes), wp.vec3d)
        self.poses = poses_at(np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), device)
        self.grip, self.grip_start = (model.surface.grip_arrays(None, count) for _ in range(2))
        points = (count, *model.surface.areas.shape)
        seen = isinstance(indenter, MeshIndenter) and not device.is_gpu
        self.pressed = filled(
            Pressed,
            surface=self.surface,
            bodies=body_of(indenter, device=device.name),
            poses=self.poses,
            grip=self.grip,
            positions=self.positions,
            seen=device.zeros(points if seen else (0, 0, 0), Seen),
        )
        self.gel_buffers = model.gel.buffers(count)
        self.contact_buffers = model.surface.buffers(count)
        self.grip_buffers = [device.zeros(points, wp.float64) for _ in range(2)]
        self.busy = device.zeros(1, wp.int32)
        shares = np.ones(count) if young_share is None else young_share
        self._units = device.array(inverse.unit * shares, wp.float64)
        self._dofs = device.array(model.pattern.free_dofs, wp.int32)
        patience = [*patience, *[(_NEVER, 0.0)] * 3][:3]
        self._limits = filled(
            kernels.Limits,
            overlap=OVERLAP_SHARE * model.height_m,
            tip_step=_TIP_STEP_SHARE * model.height_m,
            energy_scale=model.energy_scale_j,
            lags=friction > 0.0,
            holds_until=_NEVER if keeps else _HOLDS_UNTIL,
            keeps=keeps,
            patience_steps=wp.vec3i(*(steps for steps, _ in patience)),
            patience_shares=wp.vec3d(*(share for _, share in patience)),
        )
        self.replace_potential(potential)

    def replace_potential(self, potential: Potential | None) -> None:
        """Take another energy of the nodes from now on."""
        self._pull = pull_of(potential, self._device)
        self._record(pulls=potential is not None)

    def renew_gel(self) -> None:
        """Take over what a relaxing gel remembers from now on."""
        self._strain = self.model.gel.recorded(
            self.state.wanted, self.positions, self.gel_buffers, gel=self._gel
        )

    def evaluate(self) -> None:
        """Evaluate the environments that are wanted: gel and contact side by side on a GPU."""
        with self._device.beside(self._strain.launch):
            self._touch.launch()

    def contact(self) -> ContactForces:
        """Return the contact of the only environment, where it is."""
        return self.model.surface.forces_of(self.pressed)

    def step(self) -> None:
        """Have every environment that runs do its next thing."""
        self.evaluate()
        self._judge.launch()
        if self._hold is not None and (self._device.is_gpu or self.get("holding").any()):
            self._hold.launch()
            self._judge_again.launch()
        asked = None
        if not self._device.is_gpu or not self._inverse.scaled:
            asked = np.flatnonzero(self.state.act.numpy() == Act.SOLVE).astype(np.int32)
        if asked is None or len(asked):
            self._inverse.apply(asked, self.sources, self.found, self._prepare.launch)
        else:
            self._prepare.launch()
        self._turn.launch()

    def get(self, name: str) -> NDArray[Any]:
        """Return one of the environments' numbers, shape [environment_count]."""
        views = self._views
        return views[name] if views else np.asarray(getattr(self.state, name).numpy())

    def set(self, **numbers: float) -> None:
        """Set numbers of all environments."""
        for name, number in numbers.items():
            if self._views:
                self._views[name][:] = number
            else:
                getattr(self.state, name).fill_(number)

    def begin(self, **numbers: float) -> None:
        """Let all environments begin at where they are, with these numbers."""
        self.set(status=Status.RUNNING, mode=Mode.BEGIN, wanted=1, steps=0, since=0, recorded=0)
        change = np.inf if self._limits.lags else 0.0
        self.set(gripped_at=np.inf, grip_change=change, **numbers)

    def forget(self) -> None:
        """Forget what the last steps have shown, since another inverse takes over."""
        for array in (self.memory.counts, self.memory.next):
            array.zero_()

    def place(self, state: State, *, grip_start: Grip | None) -> None:
        """Put the only environment into a state, with its grip before the step; forget forces."""
        given = [
            (self.positions, state.positions),
            (self.poses.tips, state.tip),
            (self.poses.rotations, state.rotation),
            (self.surface.extensions, np.float64(state.extension)),
        ]
        for arrays, grip in ((self.grip, state.grip), (self.grip_start, grip_start)):
            if grip is not None:
                names = ("held", "anchors", "loads")
                given += [(getattr(arrays, name), getattr(grip, name)) for name in names]
        for array, values in given:
            if self._device.is_gpu:
                array[:1].assign(np.ascontiguousarray(values)[None])
            else:
                array.numpy()[0] = values
        for array in (self.gel_buffers[0], self.contact_buffers[0]):
            array.zero_()

    def _allocate(self, memory: int, rows: int) -> None:
        device, count = self._device, self.count
        points = int(np.prod(self.model.surface.areas.shape))
        shapes: dict[str, tuple[int, ...]] = {"gaps": (count, points), "counts": (count,)}
        shapes |= {"next": (count,), "table": (count, memory, memory)}
        shapes |= dict.fromkeys(("steps", "changes"), (count, memory, rows))
        gradients = ("gradient", "trial", "renewed")
        shapes |= dict.fromkeys((*gradients, "start", "direction"), (count, rows))
        self.memory = device.zeroed(Memory, (count, memory), **shapes)
        inverse = self._inverse
        wide = max(rows, inverse.row_count)
        self.sources = device.zeros((inverse.column_count, wide), inverse.kind)
        self.found = device.zeros(self.sources.shape, wp.float32 if inverse.scaled else wp.float64)

    def _record(self, *, pulls: bool) -> None:
        """Record the launches, which are then made again and again."""
        model, device, made = self.model, self._device, self.model.surface.kernels
        evaluated = self._evaluated()
        grips, threads = model.contact_options.is_tangential, self.threads
        judge, prepare, turn = descent_kernels(grips=grips, pulls=pulls, threads=threads)
        scaled, units = self._inverse.scaled, self._units

        def recorded(kernel: Any, inputs: list[Any]) -> Any:
            return device.record(kernel, (self.count, threads), inputs, threads)

        own = [self.state, self.memory]
        judged = [self._limits, self._dofs, self._pull, evaluated, *own]
        self._judge, self._judge_again = (
            recorded(judge, [*judged, again, self.busy]) for again in (False, True)
        )
        asks = [self.state, evaluated, self.memory, self.sources]
        self._prepare = recorded(prepare, [self._dofs, scaled, self._inverse.weights, *asks])
        found = [units, self._inverse.weights, self.found, *own, evaluated, self.busy]
        self._turn = recorded(turn, [self._limits, self._dofs, scaled, *found])
        self.renew_gel()
        self._hold, shape = None, tuple(self.contact_buffers[1].shape)
        touched = [self.pressed, self.state.wanted, *self.contact_buffers]
        self._touch = device.record(made.touch, shape, touched)
        if self._limits.lags:
            held = [self.pressed, self.state.holding, self.grip_start]
            room = [*self.contact_buffers[:2], *self.grip_buffers]
            self._hold = device.record(made.hold, shape, [*held, *room])

    def _evaluated(self) -> Any:
        """Name what an evaluation gives, nodal vectors as flat ones."""
        elastic, energies, ratios = self.gel_buffers
        contact, touched, gaps = self.contact_buffers
        points = (self.count, touched.shape[1] * touched.shape[2])
        change, limit = (each.reshape(points) for each in self.grip_buffers)
        return filled(
            kernels.Evaluated,
            positions=_flat(self.positions),
            tips=self.poses.tips,
            elastic=_flat(elastic),
            contact=_flat(contact),
            energies=energies,
            ratios=ratios,
            touched=touched.reshape(points),
            gaps=gaps.reshape(points),
            grip_change=change,
            grip_limit=limit,
        )


def _flat(vectors: Any) -> Any:
    """Return vectors [environment_count, node_count] as numbers, in the same memory."""
    count, nodes = vectors.shape
    return wp.array(
        ptr=vectors.ptr, dtype=wp.float64, shape=(count, 3 * nodes), device=vectors.device
    )
