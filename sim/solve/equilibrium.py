"""Equilibrium of a pad under one indenter, held still or pushed with a given force.

docs/explanation/solver.md describes the steps. They may begin with the surfaces slightly
overlapping, and end with every gap positive or not at all: when the residual, the norm of the
unbalanced force, is *enough*, at most ``residual_relative`` of the contact force, the floor, or
what rounding alone leaves of it; or *at a standstill that does no harm*, by the constants of
``line_search_and_convergence``, with a stiffness of one of the last steps. Rounding does that, and
a contact point that goes on and off in turn. At a standstill further up they go on. After
``iteration_max`` steps a residual that does no harm is taken, and any other is an error.

What is bonded knows no lagged pressure: points that touch take hold in the end.
"""

from dataclasses import dataclass, replace

import numpy as np

from sim.contact.surface_and_grip import ContactForces, Grip, State
from sim.device import on_host
from sim.scene.indenter import Indenter
from sim.solve.descent_state import Mode, Status
from sim.solve.descents import Descents
from sim.solve.linear_solver import StiffnessFactor
from sim.solve.model import Model
from sim.solve.refused_overlap import OVERLAP_SHARE, faces_gel, refuse_deep_overlap
from sim.solve.weight_and_inertia import Potential
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConvergenceError
from tacauchy_rig.core.time_limit_and_progress import check_time

# A residual that is always enough, over E H^2 with the pad's height H.
_FLOOR_SHARE = 1.5e-11
# Share of the rest volume from which a start counts as inside out: steps lead into a knot.
_TANGLED_SHARE = 0.1
# Of d_hat: how much nearer the indenter is where a start is factored. A factor that is too soft
# where points come to touch makes steps too long: 62 presses at 5 % take 18 % fewer evaluations and
# 13 % fewer factors with this, hold, and stiffer sliding.
_NEARER = 0.1
# Shares of d_hat below which the barrier is a parabola, tried one after the other.
EXTENSIONS = (0.25, 0.1, 0.03, 0.01, 0.003, 0.001)


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverOptions:
    """When the steps stop."""

    residual_relative: float = 1e-8  # residual norm over the contact force's norm
    load_relative: float = 1e-7  # the same where a load is asked for, which is met as closely
    # Most steps for one form of the barrier, which is relaxed where gel stays too near; each form
    # begins to count anew
    iteration_max: int = 600


@dataclass(frozen=True, slots=True, kw_only=True)
class Reuse:
    """What is kept from step to step; a small pad's factor costs as much as ten to fifteen."""

    memory: int = 16
    evaluations_max: int = 10  # a state begins with a new factor if the last took more evaluations
    # In a state, after so many steps with a factor, it is renewed if the residual is still more
    # than this share of the contact force
    patience: tuple[tuple[int, float], ...] = ((5, 1e-2), (10, 1e-3), (30, 0.0))


# Of a pad with so many unknowns a factor costs as much as 25 steps, and is kept for twice as long:
# four presses of 10,000 to 24,000 unknowns take 3 to 23 % less time for it.
_LARGE_FROM = 6_000
LARGE = Reuse(evaluations_max=20, patience=((10, 1e-2), (20, 1e-3), (40, 0.0)))
NEWTON = Reuse(memory=0, evaluations_max=0, patience=((1, 0.0),))
"""A factor of its own for every step: Newton's method."""


def rough_reuse(dof_count: int) -> Reuse:
    """Return what is kept where forces balance to 1e-5 or so: a factor lasts longer.

    A force that is to balance to 1e-10 comes to a standstill with it.
    """
    usual = LARGE if dof_count >= _LARGE_FROM else Reuse()
    return replace(usual, patience=((20, 1e-3), (40, 0.0)))


@dataclass(frozen=True, kw_only=True)
class Equilibrium:
    """A converged state's numbers."""

    iterations: int
    push_n: FloatArray  # force on the indenter, modelled part [N], shape [3]
    contact: ContactForces  # at every point
    elastic_gradient: FloatArray  # gradient of the elastic energy [N], shape [node_count, 3]
    residual_n: float  # norm of the unbalanced force [N]
    min_jacobian: float
    # The residual is above what was asked, relative and floor: rounding, a standstill or the last
    # iteration ended the steps at one that does no harm
    stalled: bool = False


class EquilibriumSolver:
    """Settles one indenter against one pad, again and again, and keeps what helps the next time.

    Attributes:
        factor: The stiffness that was factored last.
        energies_j: Of the states after every step of the last equilibrium.
    """

    def __init__(
        self,
        model: Model,
        indenter: Indenter,
        potential: Potential | None = None,
        *,
        reuse: Reuse | None = None,
    ) -> None:
        if reuse is None:
            reuse = LARGE if model.pattern.dof_count >= _LARGE_FROM else Reuse()
        self.model, self.indenter, self.reuse = model, indenter, reuse
        self.factor = StiffnessFactor(model, indenter, potential)
        self.energies_j: list[float] = []
        self._descents = Descents(
            model,
            indenter,
            self.factor,
            potential=potential,
            memory=self.reuse.memory,
            patience=self.reuse.patience,
        )
        self._begins_anew = self._was_held = True
        self._extensions: tuple[float, ...] = (model.contact_options.extension, *EXTENSIONS)

    @property
    def evaluations(self) -> int:
        """Of the forces, made so far."""
        return int(self._now("evaluations"))

    def replace_potential(self, potential: Potential | None) -> None:
        """Take another energy of the nodes from now on."""
        self.factor.potential = potential
        self._descents.replace_potential(potential)

    def settle(
        self,
        state: State,
        *,
        load_n: float | None = None,
        must_touch: bool = False,
        options: SolverOptions,
    ) -> Equilibrium:
        """Move ``state`` to equilibrium, held or, on the modelled part, pushed by a load [N].

        Args:
            must_touch: An equilibrium in which nothing presses is none.

        Raises:
            ConvergenceError: No equilibrium was found; ``state`` is left where the steps stopped.
        """
        descents, contact = self._descents, self.model.contact_options
        if (load_n is None) != self._was_held:  # another unknown, the indenter's height
            descents.forget()
            self._was_held = load_n is None
        if self.model.relaxation is not None:
            descents.renew_gel()
        self.energies_j, grip_start, spent = [], state.grip, 0
        begins_anew, start, error = self._begins_anew, state.copy(), None
        self._begins_anew = True  # where this one fails
        self.factor.held = load_n is None
        # What was too stiff a while ago is likely to be so again.
        for extension in [each for each in self._extensions if each <= state.extension]:
            state.extension = extension
            descents.begin(
                pushed=int(load_n is not None),
                load=load_n or 0.0,
                relative=options.residual_relative,
                floor=_FLOOR_SHARE * self.model.young_pa * self.model.height_m**2,
                steps_max=options.iteration_max,
                gap_least=contact.gap_least_m(extension),
                rounding=self.model.gel.rounding_n,
                checked=0,
                rough=1,
            )
            descents.place(state, grip_start=grip_start)
            if begins_anew:
                self.take_factor(self._about_to_touch(state))
            first, status = self.evaluations, self._run(state, grip_start, factored=begins_anew)
            spent += int(self._now("steps"))
            if status == Status.DONE:
                found = self._equilibrium(spent)
                error = self._passed_through(state, found, must_touch=must_touch)
                if error is None:
                    self._begins_anew = self.evaluations - first > self.reuse.evaluations_max
                    return found
                # The next states would pass through this barrier, too.
                self._extensions = tuple(each for each in self._extensions if each < extension) or (
                    extension,
                )
            gap = self._now("gap_min")
            if status == Status.DONE or gap < -2.0 * OVERLAP_SHARE * self.model.height_m:
                # Inside of the indenter nobody knows the way out.
                state.positions, state.tip = start.positions.copy(), start.tip.copy()
            begins_anew = True
        if error is not None:
            raise error
        raise ConvergenceError(
            f"the gel is pressed through the contact barrier: smallest gap {gap * 1e9:.3g} nm",
            remedy="give the indenter a fillet, coarsen the mesh at its rim, or widen the barrier",
        )

    def _passed_through(
        self, state: State, found: Equilibrium, *, must_touch: bool
    ) -> ConvergenceError | None:
        """Return what is wrong with an equilibrium in which the indenter is inside the gel."""
        if self.model.contact_options.bonded:
            return None
        forces, outward = found.contact.forces, self.model.surface.area_vectors(state.positions)
        faces = faces_gel(forces, outward, friction=self.model.contact_options.friction)
        if faces and (found.push_n[2] > 0.0 or not must_touch):
            return None
        return ConvergenceError(
            "the indenter has passed through the gel's surface and "
            + ("touches it from inside" if forces.any() else "touches nothing"),
            remedy="press less deep, or take a finer --preset, which has more points under the "
            "indenter",
        )

    def take_factor(self, state: State, *, first: int = 0) -> None:
        """Factor a state's stiffness; what was learnt of another is forgotten."""
        self.factor.renew(state, first=first)
        self._descents.forget()
        self._descents.set(since=0, attempt=self.factor.attempt, first_try=1.0)

    def _about_to_touch(self, state: State) -> State:
        """Return a start with the indenter nearer: a factor of it knows points about to touch."""
        if not self.model.contact_options.is_wide:
            return state
        nearer = state.copy()
        nearer.tip[2] -= _NEARER * self.model.contact_options.distance_m
        if not self.model.contact_options.bonded:
            self.model.surface.refresh_grip(self.indenter, nearer)
        return nearer

    def _run(self, state: State, grip_start: Grip | None, *, factored: bool) -> int:
        """Run from a state, ``factored`` or not, and give what is asked for; say how it ended."""
        descents, counted = self._descents, 0
        while True:
            check_time()
            descents.step()
            if (steps := int(self._now("steps"))) > counted:
                self.energies_j.append(self._now("energy"))
                counted = steps
            if (status := int(self._now("status"))) == Status.RUNNING:
                continue
            state.positions = on_host(descents.positions)[0].copy()
            state.tip = on_host(descents.poses.tips)[0].copy()
            state.grip = self.model.surface.grip_of(descents.grip)
            if status in (Status.DONE, Status.TOO_NEAR):
                return status
            if status == Status.ASKS_START:
                if self._starts_at_rest(state) or not factored:
                    self.take_factor(state)
                descents.place(state, grip_start=grip_start)
                descents.set(checked=1, mode=Mode.BEGIN, wanted=1)
            elif status in (Status.ASKS_FACTOR, Status.ASKS_SAFER_FACTOR):
                self.take_factor(state, first=int(status == Status.ASKS_SAFER_FACTOR))
                descents.set(mode=Mode.GO)
            else:
                raise self._stopped(status)
            descents.set(status=Status.RUNNING)

    def _stopped(self, status: int) -> ConvergenceError:
        steps, slope = self._now("steps"), self._now("slope")
        remedy = "press less deep, give the indenter a fillet, or take a finer --preset"
        if status == Status.NOT_FINITE:
            message = f"the residual is not finite after {steps:.0f} steps"
            remedy = "press less deep, or use the stable-neo-hookean law"
        elif status == Status.NO_DESCENT:
            message = f"the line search found no descent along a direction of slope {slope:.3g} J"
        else:
            residual, scale = self._now("residual"), self._now("scale")
            message = f"no equilibrium after {steps:.0f} steps: residual {residual:.3g} N "
            message += f"at a contact force of {scale:.4g} N"
        return ConvergenceError(message, remedy=remedy)

    def _starts_at_rest(self, state: State) -> bool:
        """Begin at rest in place of a start that is inside out, and return whether it is."""
        model, ratios = self.model, on_host(self._descents.gel_buffers[2])[0]
        volume = model.discretisation.volumes[ratios <= 0.0].sum()
        inside_out = bool(volume >= _TANGLED_SHARE * model.volume_m3)
        if inside_out:
            state.positions = np.where(model.clamped[:, None], state.positions, model.nodes)
        refuse_deep_overlap(model, self.indenter, state)
        return inside_out

    def _equilibrium(self, iterations: int) -> Equilibrium:
        descents, residual_n = self._descents, self._now("residual")
        enough_n = max(self._now("relative") * self._now("scale"), self._now("floor"))
        return Equilibrium(
            iterations=iterations,
            push_n=descents.get("push")[0].copy(),
            contact=descents.contact(),
            elastic_gradient=on_host(descents.gel_buffers[0])[0].copy(),
            residual_n=residual_n,
            min_jacobian=self._now("ratio_min"),
            stalled=residual_n > enough_n,
        )

    def _now(self, name: str) -> float:
        """Return one of the descent's numbers."""
        return float(self._descents.get(name)[0])
