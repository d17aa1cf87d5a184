"""Which effects a scene calls for: ``Scene`` in, ``EffectPlan`` out.

Every effect that a scene has but does not need within its tolerance is left out: the plan adds up
the estimated errors, smallest first, and stops before the sum passes the tolerance. What is off is
not compiled, not launched and not allocated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from sim.effects import estimates
from sim.effects.mesh_choice import mirrors
from sim.scene.indenter import Cylinder, Plane, Sphere
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Effect, Output, Preset, Scene
from tacauchy_rig.errors import ConfigError

PRESET_TOLERANCE = {
    Preset.FAST: 0.05,
    Preset.BALANCED: 0.02,
    Preset.ACCURATE: 0.005,
    Preset.REFERENCE: 2e-4,
    Preset.PAPER: 2e-4,
}
_SELF_CONTACT_DEPTH_SHARE = 0.6
_DRAWN = {
    Effect.IMAGE: Output.IMAGE,
    Effect.SHADOW: Output.SHADOW,
    Effect.MARKERS: Output.MARKERS,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedEffect:
    """One row of a plan.

    Attributes:
        on: It is simulated.
        reason: Why, with the numbers.
        estimated_error: Relative error of F_z if it is left out; zero where it changes nothing,
            None where leaving it out would answer another question.
        asked: The user switched it.
    """

    effect: Effect
    on: bool
    reason: str
    estimated_error: float | None
    asked: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectPlan:
    """What is simulated of a scene, and why.

    Attributes:
        tolerance: Relative error of F_z that all effects left out may have together.
    """

    effects: tuple[PlannedEffect, ...]
    tolerance: float

    def is_on(self, effect: Effect) -> bool:
        """Return whether an effect is simulated."""
        return next(row.on for row in self.effects if row.effect is effect)

    @property
    def estimated_error(self) -> float:
        """Sum of the estimated errors of what is left out."""
        return sum(row.estimated_error or 0.0 for row in self.effects if not row.on)

    def as_json(self) -> list[dict[str, Any]]:
        """Return the rows for ``--json``."""
        return [
            {
                "name": row.effect.value,
                "on": row.on,
                "reason": row.reason,
                "estimated_error": row.estimated_error,
                "asked": row.asked,
            }
            for row in self.effects
        ]


def plan_effects(scene: Scene) -> EffectPlan:
    """Decide what a scene is simulated with.

    Raises:
        ConfigError: The user switched something on or off that cannot be.
    """
    tolerance = PRESET_TOLERANCE[scene.preset] if scene.tolerance is None else scene.tolerance
    called = {row.effect: row for row in _called_for(scene)}
    rows = dict(called)
    doubtful = [row for row in rows.values() if row.on and row.estimated_error is not None]
    spent = 0.0
    for row in sorted(doubtful, key=lambda row: row.estimated_error or 0.0):
        if row.effect in _ALWAYS_IF_CALLED:
            continue
        spent += row.estimated_error or 0.0
        if spent > tolerance:
            break
        reason = f"{row.reason}; left out: within the tolerance of {tolerance:.2%}"
        rows[row.effect] = replace(row, on=False, reason=reason)
    for effect, on in scene.effects:
        if on and not called[effect].on and effect in _CANNOT_BE_ADDED:
            raise ConfigError(
                f"effect {effect.value} cannot be switched on: {called[effect].reason}",
                remedy=_CANNOT_BE_ADDED[effect],
            )
        rows[effect] = _switched(called[effect], on=on)
    return EffectPlan(effects=tuple(rows[effect] for effect in Effect), tolerance=tolerance)


_ALWAYS_IF_CALLED = {Effect.SYMMETRY, Effect.SECOND_LAYER, *_DRAWN}


def _switched(row: PlannedEffect, *, on: bool) -> PlannedEffect:
    if on == row.on:
        return replace(row, asked=True)
    return replace(row, on=on, asked=True, reason=f"switched by the user; {row.reason}")


_CANNOT_BE_ADDED = {
    Effect.SELF_CONTACT: "leave it off: gel against gel is not simulated",
    Effect.SECOND_LAYER: "give the layers",
    Effect.SYMMETRY: "centre the indenter and move it within one middle plane of the pad",
    Effect.VISCOELASTICITY: "give the material a Prony series",
    Effect.FRICTION: "ask for --contact friction:MU",
}


def _called_for(scene: Scene) -> Iterator[PlannedEffect]:
    decided = {
        Effect.INERTIA: _inertia,
        Effect.GRAVITY: _gravity,
        Effect.FRICTION: _friction,
        Effect.FINITE_STRAIN: _finite_strain,
        Effect.LOCKING_FREE_ELEMENT: _locking,
        Effect.SECOND_LAYER: _layers,
        Effect.VISCOELASTICITY: _relaxation,
        Effect.SELF_CONTACT: _self_contact,
        Effect.SYMMETRY: _symmetry,
    }
    for effect, decide in decided.items():
        on, reason, error = decide(scene)
        # What leaves finite strain out is the law that was asked for.
        asked = effect is Effect.FINITE_STRAIN and not on
        yield PlannedEffect(effect=effect, on=on, reason=reason, estimated_error=error, asked=asked)
    for effect, output in _DRAWN.items():
        wanted = output in scene.outputs
        reason = "asked for" if wanted else "not asked for"
        yield PlannedEffect(effect=effect, on=wanted, reason=reason, estimated_error=0.0)


# Whether an effect is on, the reason, and the error of leaving it out.
_Decision = tuple[bool, str, float | None]


def _inertia(scene: Scene) -> _Decision:
    period = estimates.slowest_period(scene)
    reason = f"in proportion to (T1 / t)^2, T1 = {period * 1e3:.2g} ms, t = {scene.duration_s:g} s"
    return True, reason, estimates.inertia_error(scene)


def _gravity(scene: Scene) -> _Decision:
    return True, "rho g H / E of the softest material", estimates.gravity_error(scene)


def _friction(scene: Scene) -> _Decision:
    if scene.contact is not ContactMode.FRICTION or scene.friction == 0.0:
        return False, f"the contact is {scene.contact.value}", 0.0
    if not scene.motion.is_straight or Output.MARKERS in scene.outputs:
        return True, "the indenter moves along the gel, or markers are asked for", None
    reason = f"a straight press at nu {scene.material.poisson:g}: friction changes F_z little"
    return True, reason, estimates.frictionless_error(scene)


def _finite_strain(scene: Scene) -> _Decision:
    laws = {material.law for material in scene.materials}
    if LawName.LINEAR in laws:
        return False, "the law is linear", None
    if LawName.PAPER_EQ4 in laws:
        return (
            True,
            "the printed law is under tension at rest, which small strains do not know",
            None,
        )
    share = estimates.expected_depth(scene) / scene.pad.height_m
    error = estimates.linear_error(scene) if scene.motion.is_straight else None
    return True, f"depth is {share:.1%} of the pad's thickness", error


def _locking(scene: Scene) -> _Decision:
    error = estimates.locking_error(scene)
    if scene.preset is Preset.PAPER:
        return False, "preset paper has the paper's linear tetrahedra, which lock", error
    poisson = max(material.poisson for material in scene.materials)
    return True, f"nu is {poisson:g}; linear tetrahedra lock above 0.4", error


def _layers(scene: Scene) -> _Decision:
    if len(scene.layers) > 1:
        return True, f"the gel has {len(scene.layers)} layers", None
    return False, "the gel is of one material", 0.0


def _relaxation(scene: Scene) -> _Decision:
    if not any(material.relaxation for material in scene.materials):
        return False, "the material has no Prony series", 0.0
    reason = f"force above the slow modulus's at the end of {scene.duration_s:g} s"
    return True, reason, estimates.relaxation_error(scene)


def _self_contact(scene: Scene) -> _Decision:
    share = estimates.expected_depth(scene) / scene.pad.height_m
    convex = isinstance(scene.indenter, Cylinder | Sphere | Plane)
    if convex and share <= _SELF_CONTACT_DEPTH_SHARE:
        return False, "a convex pad under one convex indenter cannot touch itself", 0.0
    reason = "gel against gel is not simulated; min det F and the gap tell where it would matter"
    return False, reason, None


def _symmetry(scene: Scene) -> _Decision:
    if mirrors(scene).copies > 1:
        return True, "pad, indenter and motion are mirrored: a quarter or half is solved", 0.0
    return False, "no plane mirrors pad, indenter, motion and mesh", 0.0
