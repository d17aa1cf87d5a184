"""A loading path: the indenter advanced, pushed, carried and turned against one pad.

It is advanced to a depth, pushed with a force, or carried along and about its axis while its depth
or its force is held. Each of these is a phase with one parameter that grows. Weight, and a law with
stress at rest, deform the pad before it is touched; depths count from first touch of that shape.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from sim.contact.surface_and_grip import State
from sim.scene.indenter import Indenter, Plane
from sim.solve.equilibrium import EquilibriumSolver, SolverOptions
from sim.solve.load_steps import STEP_SHARE, CarryPhase, ForcePhase, Phase, Stepping
from sim.solve.model import Model
from sim.solve.path_point import PathCounts, PathPoint
from sim.solve.refused_overlap import OVERLAP_SHARE
from sim.solve.weight_and_inertia import Potential
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError, ConvergenceError
from tacauchy_rig.core.time_limit_and_progress import check_time, doing

# Height of an indenter that touches nothing, in heights of the pad.
_CLEARANCE_HEIGHTS = 10.0
# Of the pad's height: how closely first touch is found.
_EXACT_SHARE, _TRIES = 2.5e-10, 100


def unloaded_positions(
    model: Model, *, options: SolverOptions, potential: Potential | None = None
) -> FloatArray:
    """Return the nodes at equilibrium without an indenter [m], shape [node_count, 3].

    Where nothing deforms the pad, these are the undeformed nodes and nothing is solved.

    Raises:
        ConvergenceError: No equilibrium was found.
    """
    if potential is None and model.law.rest_stress(model.young_pa, model.poisson) == 0.0:
        return model.nodes
    state = model.rest_state(tip=np.array([0.0, 0.0, _CLEARANCE_HEIGHTS * model.height_m]))
    EquilibriumSolver(model, Plane(), potential).settle(state, options=options)
    return state.positions


def touch_height(
    model: Model,
    indenter: Indenter,
    unloaded: FloatArray,
    *,
    centre_m: tuple[float, float],
    rotation: FloatArray,
) -> float:
    """Return the tip height of first touch of the unloaded pad [m]: a gap of d_hat.

    Counted from there, a press depends on d_hat ten times less than counted from gap zero: the
    gel then stays d_hat (1 - s) off, s near 1, instead of d_hat s.

    Args:
        unloaded: Nodes of the pad before it is touched [m], shape [node_count, 3].

    Raises:
        ConfigError: The indenter comes down beside the pad.
    """
    high = float(unloaded[:, 2].max())
    distance = model.contact_options.distance_m
    state = model.rest_state(tip=np.array([*centre_m, high]), rotation=rotation)
    for _ in range(_TRIES):
        check_time()
        gap = float(model.surface.gaps(unloaded, indenter, state).min()) - distance
        if abs(gap) < _EXACT_SHARE * model.height_m:
            break
        state.tip[2] -= gap
        if state.tip[2] < 0.0:
            x, y = centre_m
            raise ConfigError(
                f"the indenter at x = {x * 1e3:.4g} mm, y = {y * 1e3:.4g} mm comes down beside "
                "the pad and never touches its top",
                remedy="move it over the pad",
            )
    return float(state.tip[2])


# Of the longest step if nothing else is said: the first one where points take hold.
# Under a flat punch 0.05 mm take 872 evaluations in one step, 347 in two.
_GRIPPING_SHARE = 0.25
# Differences from a depth, over the pad's height, and from a force, over it, that rounding leaves.
_DEPTH_EXACT_SHARE, _FORCE_EXACT_SHARE = 2.5e-12, 1e-12
# Of a push's time, until its force has a tangent to go by: a guess.
_TOUCHING_SHARE, _TOUCHING_TRIES = 0.02, 3


class Hold(StrEnum):
    """What stays as it is while the indenter is carried."""

    DEPTH = "depth"
    FORCE = "force"


@dataclass(slots=True)
class LoadingPath(Stepping):
    """Moves one indenter against one pad: by depth, by force, and along it.

    What moves or settles it raises ConvergenceError where an increment failed even at the smallest
    step, or before it was pressed in; the message names the last depth that was reached, and
    ``last`` holds it.
    """

    # Nodes of the pad before it is touched [m]: undeformed, unless weight or the law's stress at
    # rest deform it
    unloaded: FloatArray = field(init=False)
    setup_s: float = field(init=False)

    def __post_init__(self) -> None:
        started = time.perf_counter()
        Stepping.__post_init__(self)
        self.unloaded = unloaded_positions(
            self.model, options=self.options, potential=self.potential
        )
        for memory in self.memories:
            memory.forget(self.unloaded)
        self.touch_m = touch_height(
            self.model, self.indenter, self.unloaded, centre_m=self.centre_m, rotation=self.rotation
        )
        self.touch_m += self.blunted_m  # depth counts from where the sharp tip would touch
        self.setup_s = time.perf_counter() - started

    def stiffer(self, factor: float) -> LoadingPath:
        """Return the same path, at its start, in a gel that is so many times as stiff.

        Raises:
            ConfigError: Weight, mass or relaxation is modelled: they do not scale with stiffness.
        """
        if self.potential is not None or self.memories:
            raise ConfigError(
                "a gel with weight, mass or relaxation goes another way if it is stiffer",
                remedy="press the stiffer gel from the start",
            )
        model = self.model.stiffer(factor)
        return replace(self, model=model, counts=PathCounts(), keeps_all=False)

    def taken_over(self, point: PathPoint, *, stiffer: float) -> PathPoint:
        """Return a point of another path in the same gel, so many times less stiff, as one of this.

        At forces as many times larger, a stiffer gel is deformed as the other was.
        """
        state = point.state.copy()
        if state.grip is not None:
            state.grip.loads = stiffer * state.grip.loads
        found = self.settle(state, intermediate=True)
        return replace(found, stiffness_n_m=stiffer * point.stiffness_n_m)

    def resume(self, state: State, *, load_n: float | None, stiffness_n_m: float) -> PathPoint:
        """Settle a state that no step of this path led to, such as another mesh's, and go on there.

        Args:
            load_n: F_z that the indenter carries, while its depth follows [N]; None holds it.
            stiffness_n_m: dF_z / d(depth) there [N/m], which one state alone does not tell.
        """
        started = time.perf_counter()
        touches = self.must_touch(self.touch_m - float(state.tip[2]))
        found = self.settle(state, load_n=load_n, must_touch=touches, intermediate=False, ends=True)
        self.counts.wall_s += time.perf_counter() - started
        return self.accept(replace(found, stiffness_n_m=stiffness_n_m))

    def advance(
        self, depth_m: float, *, start: PathPoint | None = None, duration_s: float | None = None
    ) -> PathPoint:
        """Press (or retract) to a depth.

        Args:
            start: Continue from here instead of from the last point.
            duration_s: Time that it takes [s], for a gel that remembers; None is for ever.

        Raises:
            ConfigError: The indenter would be below the gel's base, or at it.
        """
        if depth_m >= (most_m := self.base_depth_m(depth_m)):
            raise ConfigError(
                f"a depth of {depth_m * 1e3:.4f} mm is more than the gel has room for: at "
                f"{most_m * 1e3:.4f} mm the indenter is at its base",
                remedy="press less deep",
            )
        point = start or self.last
        if point is None:
            point = self._first(depth_m, duration_s)
            duration_s = _part(1.0 - point.depth_m / depth_m, duration_s) if depth_m > 0.0 else None
        phase = Phase(
            start=point.depth_m,
            end=depth_m,
            goal=f"{depth_m * 1e3:.4f} mm",
            step_max_m=self.step_max_m,
            exact=_DEPTH_EXACT_SHARE * self.model.height_m,
        )
        return self.go(point, phase, duration_s)

    def push(
        self, force_n: float, *, start: PathPoint | None = None, duration_s: float | None = None
    ) -> PathPoint:
        """Press (or retract) until the indenter carries a force F_z [N]; its depth is an unknown.

        ``start``, ``duration_s`` and what is raised are as for ``advance``.
        """
        if not force_n > 0.0:
            return self.advance(0.0, start=start)
        point = start or self.last
        if point is None or not point.force_n[2] > 0.0:
            touching = self._touching_share(point, force_n, duration_s)
            depth = OVERLAP_SHARE * self.model.height_m
            point = self.advance(depth, duration_s=_part(touching, duration_s))
            duration_s = _part(1.0 - touching, duration_s)
        phase = ForcePhase(
            start=float(point.force_n[2]),
            end=force_n,
            goal=f"{force_n:.4f} N",
            exact=_FORCE_EXACT_SHARE * force_n,
            step_max_m=self.step_max_m,
        )
        return self.go(point, phase, duration_s)

    def dwell(self, duration_s: float) -> PathPoint:
        """Let time pass at the same depth, as one step; a gel that relaxes pushes back less."""
        point = self._pressed("dwells")
        self.begin(duration_s)
        return self.accept(self.settle(point.state.copy(), intermediate=False))

    def carry(
        self,
        *,
        shift_m: tuple[float, float] = (0.0, 0.0),
        twist_rad: float = 0.0,
        hold: Hold = Hold.DEPTH,
        duration_s: float | None = None,
    ) -> PathPoint:
        """Translate the pressed-in indenter and turn it about z through its tip.

        Args:
            duration_s: Time that it takes [s], for a gel that remembers; None is for ever.

        Raises:
            ConfigError: The model is of a part whose mirror planes do not mirror the motion.
        """
        point = self._pressed("is carried")
        part, (x, y), turn_deg = self.model.mesh.symmetry, shift_m, math.degrees(twist_rad)
        if (part.mirror_x and (x or twist_rad)) or (part.mirror_y and (y or twist_rad)):
            raise ConfigError(
                f"a shift of ({x * 1e3:g}, {y * 1e3:g}) mm and a turn of "
                f"{turn_deg:g} deg are not mirrored as the modelled part is",
                remedy="state the motion in the scene, or switch its effect symmetry off",
            )
        phase = CarryPhase(
            goal=f"a shift of ({x * 1e3:.4f}, {y * 1e3:.4f}) mm and {turn_deg:.3f} deg",
            shift_m=np.array([*shift_m, 0.0]),
            twist_rad=twist_rad,
            load_n=float(point.force_n[2]) if hold is Hold.FORCE else None,
            step_max_m=self.step_max_m,
            radius_m=point.contact_radius_m,
        )
        return self.go(point, phase, duration_s)

    def untouched(self, depth_m: float) -> State:
        """Return the unloaded pad with the indenter at a depth."""
        tip = np.array([*self.centre_m, self.touch_m - depth_m])
        state = self.model.rest_state(tip=tip, rotation=self.rotation)
        state.positions = self.unloaded.copy()
        state.extension = self.model.contact_options.extension
        return state

    def body_force_n(self, point: PathPoint) -> FloatArray:
        """Return what weight and the like leave for clamp and indenter to carry [N], shape [3]."""
        if self.potential is None:
            return np.zeros(3)
        part = self.potential.gradient(point.state.positions)[~self.model.clamped].sum(axis=0)
        return self.model.mesh.symmetry.whole_force(part)

    def _pressed(self, what: str) -> PathPoint:
        if self.last is None:
            raise ConvergenceError(
                f"the indenter {what} before it was pressed in", remedy="press it in first"
            )
        return self.last

    def _first(self, depth_m: float, duration_s: float | None) -> PathPoint:
        options, first_m = self.model.contact_options, self.step_max_m
        if options.is_tangential:
            first_m = min(first_m, _GRIPPING_SHARE * STEP_SHARE * self.model.height_m)
        elif options.extension < 1.0:  # only a parabola throughout forgives more
            first_m = min(first_m, OVERLAP_SHARE * self.model.height_m)
        depth = min(depth_m, first_m + self.blunted_m)
        if depth_m > 0.0:
            depth = min(depth, depth_m * self.longest_share(duration_s))
        self.begin(_part(depth / depth_m, duration_s) if depth_m > 0.0 else duration_s)
        # Points that take hold, or have mass, remember an intermediate state as it is found.
        remembers = options.is_tangential or self.inertia is not None
        intermediate = depth < depth_m and not remembers
        start, touches = self.untouched(depth), self.must_touch(depth)
        with doing(f"finding the first equilibrium, {depth * 1e3:.4f} mm deep"):
            point = self.settle(start, intermediate=intermediate, must_touch=touches)
        return self.accept(point)

    def _touching_share(
        self, point: PathPoint | None, force_n: float, duration_s: float | None
    ) -> float:
        """Return the part of a push in which the indenter comes to have a tangent to go by.

        Under a force that grows evenly that is what it carries by then; found by secants of the
        logarithms: what a gel with mass carries falls with the square of the time.
        """
        if not self.memories or duration_s in (None, math.inf) or point is not None:
            return _TOUCHING_SHARE
        at, slope, known = math.log(_TOUCHING_SHARE), -1.0, None
        for _ in range(_TOUCHING_TRIES):
            self.begin(_part(math.exp(at), duration_s))
            start = self.untouched(OVERLAP_SHARE * self.model.height_m)
            carried = float(self.settle(start, intermediate=True).force_n[2])
            missed = math.log(carried / force_n) - at
            if known is not None and at != known[0]:
                slope = min(slope, (missed - known[1]) / (at - known[0]))
            known, at = (at, missed), min(0.0, at - missed / slope)
        return math.exp(at)


def _part(share: float, duration_s: float | None) -> float | None:
    """Return a part of a time; for ever stays for ever."""
    return duration_s if duration_s in (None, math.inf) else share * duration_s
