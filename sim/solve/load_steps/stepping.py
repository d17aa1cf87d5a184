"""Along a leg in steps: each started from the tangent's prediction, and cut where it fails."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from sim.contact.state import State
from sim.solve.load_steps.equilibrium import DOWN, STILL, Settling
from sim.solve.load_steps.path_point import PathPoint
from sim.solve.load_steps.phases import CarryLeg, Leg
from sim.solve.load_steps.prediction import predicted_state
from sim.solve.newton import NewtonOptions
from sim.solve.overlap import overlap_fraction
from tacauchy_rig.errors import ConfigError, ConvergenceError

logger = logging.getLogger(__name__)

_STEP_MIN_SHARE = 2e-5
# Of a leg, where a gel relaxes: its stress is taken to change evenly in a step.
_EVEN_SHARE = 0.1
_REMEMBERED = 24


@dataclass(slots=True, kw_only=True)
class Stepping:
    """Steps through equilibria, and has a gel that relaxes remember them.

    Attributes:
        last: The equilibrium that was reached last, also when a leg ended in an error.
        history: (depth [m], F_z [N]) of every equilibrium on the way.
    """

    settling: Settling
    last: PathPoint | None = None
    history: list[tuple[float, float]] = field(default_factory=list)
    _known: deque[PathPoint] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))

    def begin(self, duration_s: float | None) -> None:
        """Begin a step of a time [s]; None is for ever."""
        relaxation = self.settling.model.relaxation
        if relaxation is not None:
            relaxation.begin_step(math.inf if duration_s is None else duration_s)

    def accept(self, point: PathPoint) -> PathPoint:
        """Remember a point that is gone on from."""
        self.last = point
        self._known.append(point)
        self.history.append((point.depth_m, float(point.force_n[2])))
        relaxation = self.settling.model.relaxation
        if relaxation is not None:
            relaxation.commit(point.state.positions)
        return point

    def go(
        self, point: PathPoint, leg: Leg, *, duration_s: float | None, options: NewtonOptions
    ) -> PathPoint:
        """Go along a leg from a point, the last one or an earlier.

        Raises:
            ConvergenceError: An increment failed even at the smallest step; the message names the
                last depth that was reached, ``last`` holds it.
            ConfigError: A gel that relaxes would have to go back.
        """
        started = time.perf_counter()
        point = self._resume(point)
        whole = abs(leg.end - leg.start)
        pace = None if duration_s is None else duration_s / max(whole, 1e-300)
        even = whole * self._even_share(duration_s)
        at, step = leg.start, min(leg.longest(point.stiffness_n_m), even)
        while leg.is_short_of(at):
            advance = float(np.clip(leg.end - at, -step, step))
            try:
                found, taken = self._increment(point, leg, at, advance, pace, options)
            except ConvergenceError as error:
                step = abs(advance) / 4.0
                logger.debug("increment of %.3g failed: %s", advance, error.message)
                if step < leg.longest(point.stiffness_n_m) * _STEP_MIN_SHARE:
                    raise _stopped(point, leg, error) from error
                self.settling.refresh(point)
                continue
            point = self.accept(found)
            at = leg.end if abs(leg.end - at - taken) <= leg.exact else at + taken
            step = min(leg.longest(point.stiffness_n_m), 2.0 * max(step, abs(taken)), even)
        self.settling.counts.wall_s += time.perf_counter() - started
        return point

    def _resume(self, point: PathPoint) -> PathPoint:
        if point is self.last:
            return point
        if self.settling.model.relaxation is not None:
            raise ConfigError(
                "a gel that relaxes cannot go back to an earlier point of its path",
                remedy="drive it by load or by depth, not by the displacement search",
            )
        self.settling.refresh(point)
        self.last = point
        return point

    def _even_share(self, duration_s: float | None) -> float:
        """Return the part of a leg in which a relaxing gel's stress may be taken as a ramp."""
        remembers = self.settling.model.relaxation is not None
        lasts = duration_s is not None and math.isfinite(duration_s)
        return _EVEN_SHARE if remembers and lasts else 1.0

    def _increment(
        self,
        point: PathPoint,
        leg: Leg,
        at: float,
        advance: float,
        pace: float | None,
        options: NewtonOptions,
    ) -> tuple[PathPoint, float]:
        """Go one step; return where that led and how much of the leg was done."""
        if self.settling.quick is not None and not isinstance(leg, CarryLeg):
            count = self.settling.quick.options.points
            state = self._predicted(point, leg, at + advance, advance, count)
            return self._settled(state, point, leg, at + advance, options), advance
        settling, found, state = self.settling, point.equilibrium, point.state.copy()
        velocity, spin = leg.rate(point.stiffness_n_m)
        motion, lift = settling.response(point.state, found, velocity, spin)
        if leg.holds_force:
            sink = -lift / max(point.stiffness_n_m, 1e-30)
            motion = motion + sink * settling.response(point.state, found, DOWN, STILL)[0]
            velocity = velocity + sink * DOWN
        turned = leg.turned(state.rotation, advance)
        tip = state.tip + advance * velocity
        state.rotation = turned
        fraction = overlap_fraction(settling.model, settling.indenter, state, tip, advance * motion)
        if np.any(spin) and fraction < 1.0:
            raise ConvergenceError("the next turn would overlap the indenter")
        if fraction * abs(advance) < leg.longest(point.stiffness_n_m) * 1e-6:
            raise ConvergenceError("the next step would overlap the indenter")
        state.positions = state.positions + fraction * advance * motion
        state.tip = state.tip + fraction * (tip - state.tip)
        reached = at + fraction * advance
        self.begin(None if pace is None else pace * fraction * abs(advance))
        return self._settled(state, point, leg, reached, options), fraction * advance

    def _predicted(
        self, point: PathPoint, leg: Leg, to: float, advance: float, count: int
    ) -> State:
        """Return the state straight up or down from a point to which the points so far lead."""
        known = [k for k in self._known if _stand_alike(k.state, point.state)]
        held = leg.load_at(to) is None
        places = [k.depth_m if held else float(k.force_n[2]) for k in known]
        state = predicted_state(known, places, at=to, step=advance, count=count)
        if held:
            state.tip[2] = self.settling.touch_m - to
        return state

    def _settled(
        self, state: State, point: PathPoint, leg: Leg, at: float, options: NewtonOptions
    ) -> PathPoint:
        return self.settling.settle(
            state,
            load_n=leg.load_at(at),
            passing=leg.is_short_of(at),
            options=options,
            before=point,
        )


def _stand_alike(one: State, other: State) -> bool:
    """Return whether the indenter stands at the same place and turned alike, at any height."""
    beside = np.array_equal(one.tip[:2], other.tip[:2])
    return beside and np.array_equal(one.rotation, other.rotation)


def _stopped(point: PathPoint, leg: Leg, error: ConvergenceError) -> ConvergenceError:
    return ConvergenceError(
        f"the press stopped at {point.depth_m * 1e3:.4f} mm and "
        f"{point.force_n[2]:.4f} N on the way to {leg.goal}: {error.message}",
        remedy=error.remedy,
    )
