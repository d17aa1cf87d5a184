"""Plans held against everything switched on: what was left out, and what that changed and saved."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from importlib import resources
from typing import Any

import numpy as np

from sim.effects.plan import EffectPlan, plan_effects
from sim.press import press
from sim.press_command import scene_from
from sim.scene.material import RelaxationTerm
from sim.scene.scene import ContactMode, Effect, Scene, Target


@dataclass(frozen=True, slots=True)
class EffectCase:
    """A scene and what sets it apart.

    Attributes:
        whole: Hold it against the whole pad, to show what symmetry is worth.
    """

    name: str
    shows: str
    scene: Scene
    whole: bool = False


def _case(
    name: str,
    shows: str,
    press: str,
    *,
    whole: bool = False,
    relaxation: Sequence[dict[str, float]] = (),
    density_kg_m3: float = 1000.0,
) -> EffectCase:
    """Return a case of ``cases.toml``; relaxation and density are no words of a press."""
    scene = scene_from(press)
    terms = tuple(RelaxationTerm(**term) for term in relaxation)
    material = replace(scene.material, relaxation=terms, density_kg_m3=density_kg_m3)
    return EffectCase(name, shows, replace(scene, material=material), whole)


_FILE = resources.files("sim.studies.effects_check").joinpath("cases.toml")
EFFECT_CASES = tuple(_case(**each) for each in tomllib.loads(_FILE.read_text("utf-8"))["case"])


# Effects that change the mechanics and can be switched on where a scene has them.
_SWITCHED_ON = (
    Effect.INERTIA,
    Effect.GRAVITY,
    Effect.FRICTION,
    Effect.FINITE_STRAIN,
    Effect.LOCKING_FREE_ELEMENT,
    Effect.VISCOELASTICITY,
)
_OWN_KERNELS = {Effect.FRICTION, Effect.FINITE_STRAIN, Effect.VISCOELASTICITY}
_TOUCH_M = 5e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedPress:
    """A press and the processor's time for it [s], which a busy machine does not change."""

    force_n: tuple[float, ...]
    depth_m: float
    node_count: int
    newton_iterations: int
    processor_s: float
    wall_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Omission:
    """The plan's scene without one more effect.

    Attributes:
        estimated: Error that the plan expected of that.
        measured: Relative difference of the force, or of the depth where the force is given.
        time_ratio: Processor time with it over that without it.
    """

    effect: Effect
    estimated: float
    measured: float
    time_ratio: float


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectCheck:
    """A scene under its plan and with everything on.

    Attributes:
        added: What was off and is on in the full press.
        left_apart: What could not be combined with the rest, and why.
        difference: Of the force as a vector over its size, or of the depth where the force is
            given.
        omissions: What is on but could be off, one by one.
    """

    case: EffectCase
    plan: EffectPlan
    planned: TimedPress
    full: TimedPress
    added: tuple[Effect, ...]
    left_apart: tuple[tuple[Effect, str], ...]
    difference: float
    omissions: tuple[Omission, ...]

    @property
    def passed(self) -> bool:
        """The plan kept what it promised."""
        return self.difference <= self.plan.tolerance

    @property
    def time_ratio(self) -> float:
        """Processor time of everything on over that of the plan."""
        return self.full.processor_s / self.planned.processor_s

    @property
    def needless(self) -> tuple[Omission, ...]:
        """What the plan simulates although leaving it out besides would have been good enough."""
        return tuple(
            omission
            for omission in self.omissions
            if omission.measured + self.difference <= self.plan.tolerance
        )

    def as_json(self) -> dict[str, Any]:
        """Return plain values for ``--json``."""
        return {
            "name": self.case.name,
            "shows": self.case.shows,
            "passed": self.passed,
            "tolerance": self.plan.tolerance,
            "estimated_error": self.plan.estimated_error,
            "difference": self.difference,
            "time_ratio": self.time_ratio,
            "planned": asdict(self.planned),
            "full": asdict(self.full),
            "added": [effect.value for effect in self.added],
            "left_apart": {effect.value: why for effect, why in self.left_apart},
            "omissions": [asdict(omission) for omission in self.omissions],
            "needless": [omission.effect.value for omission in self.needless],
            "effects": self.plan.as_json(),
        }


def check_effects(case: EffectCase, *, one_by_one: bool = True) -> EffectCheck:
    """Press a scene under its plan and with everything on.

    Args:
        one_by_one: Also leave out every effect that is on but could be off, one by one.

    Raises:
        ConvergenceError: A press has no equilibrium.
    """
    plan = plan_effects(case.scene)
    everything, left_apart = everything_on(case.scene, whole=case.whole)
    switched = dict(everything.effects)
    added = [effect for effect, on in switched.items() if on and not plan.is_on(effect)]
    planned = _timed(case.scene, load=True)
    full = _timed(everything, load=not _OWN_KERNELS.isdisjoint(added))
    if case.whole and plan.is_on(Effect.SYMMETRY):
        added.append(Effect.SYMMETRY)
    return EffectCheck(
        case=case,
        plan=plan,
        planned=planned,
        full=full,
        added=tuple(added),
        left_apart=left_apart,
        difference=difference(planned, full, case.scene),
        omissions=_omissions(case.scene, planned, plan) if one_by_one else (),
    )


def everything_on(
    scene: Scene, *, whole: bool = False
) -> tuple[Scene, tuple[tuple[Effect, str], ...]]:
    """Return the scene with all that it can have, and what cannot be combined, and why.

    Args:
        whole: Undo the symmetry too: it saves work instead of adding to it.
    """
    left_apart = []
    switches = {Effect.SYMMETRY: False} if whole else {}
    called = plan_effects(replace(scene, tolerance=0.0, effects=()))
    for effect in _SWITCHED_ON:
        why_not = _why_no_inertia(scene) if effect is Effect.INERTIA else ""
        if why_not:
            left_apart.append((effect, why_not))
        if called.is_on(effect):
            switches[effect] = not why_not
    return replace(scene, effects=tuple(switches.items())), tuple(left_apart)


def difference(one: TimedPress, other: TimedPress, scene: Scene) -> float:
    """Return how far a press is from another, relative to the other."""
    if scene.target.force_n is not None:
        return abs(one.depth_m / other.depth_m - 1.0)
    away = np.subtract(one.force_n, other.force_n)
    return float(np.linalg.norm(away) / np.linalg.norm(other.force_n))


def _why_no_inertia(scene: Scene) -> str:
    if scene.contact is not ContactMode.FRICTIONLESS:
        return f"a press in time has no {scene.contact.value} contact"
    if scene.target.depth_m is None:
        return "a press in time goes to a depth, not to a force"
    if not scene.motion.is_straight:
        return "a press in time goes straight down and is not tilted"
    return ""


def _omissions(scene: Scene, planned: TimedPress, plan: EffectPlan) -> tuple[Omission, ...]:
    """Leave out each effect that is on but could be off."""
    rows = [
        row for row in plan.effects if row.on and row.estimated_error and row.effect in _SWITCHED_ON
    ]
    found = []
    for row in rows:
        kept = {r.effect: r.on for r in plan.effects if r.effect in _SWITCHED_ON}
        without = _timed(
            replace(scene, effects=tuple((kept | {row.effect: False}).items())),
            load=row.effect in _OWN_KERNELS,
        )
        found.append(
            Omission(
                effect=row.effect,
                estimated=row.estimated_error or 0.0,
                measured=difference(without, planned, scene),
                time_ratio=planned.processor_s / without.processor_s,
            )
        )
    return tuple(found)


def _timed(scene: Scene, *, load: bool) -> TimedPress:
    """Press.

    Args:
        load: Touch the gel once before, so that loading kernels is not counted.
    """
    if load:
        still = dict(scene.effects) | {Effect.INERTIA: False}
        press(replace(scene, target=Target(depth_m=_TOUCH_M), effects=tuple(still.items())))
    wall, processor = time.perf_counter(), time.process_time()
    result = press(scene)
    return TimedPress(
        force_n=tuple(map(float, result.force_n)),
        depth_m=result.depth_m,
        node_count=result.node_count,
        newton_iterations=result.newton_iterations,
        processor_s=time.process_time() - processor,
        wall_s=time.perf_counter() - wall,
    )
