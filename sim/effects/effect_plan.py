"""Effects that a scene calls for by its definition alone, and the data of a plan.

``sim.effects.plan`` tries the effects that stay open on coarse meshes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from sim.effects import estimates
from sim.effects.mesh_choice import mirrors
from sim.scene.indenter import Cylinder, Plane, Sphere
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Effect, Output, Preset, Scene
from tacauchy_rig.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedEffect:
    """One row of a plan.

    Attributes:
        on: It is simulated.
        reason: Why, with the numbers.
        costs: Relative error of each output if it is left out; empty where it changes nothing,
            None where nobody knows.
        asked: The user switched it.
    """

    effect: Effect
    on: bool
    reason: str
    costs: dict[Output, float] | None = None
    asked: bool = False

    @property
    def estimated_error(self) -> float | None:
        """Relative error of the force (or of the depth that it asks for) if it is left out."""
        if self.costs is None:
            return None
        return max(self.costs.get(Output.FORCE, 0.0), self.costs.get(Output.DEPTH, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectPlan:
    """What is simulated of a scene, and why.

    Attributes:
        tolerances: Relative error of each output that is asked for that all effects left out may
            have together.
        tried_s: Processor time of the coarse presses that it rests on [s].
    """

    effects: tuple[PlannedEffect, ...]
    tolerances: dict[Output, float] = field(default_factory=dict)
    tried_s: float = 0.0

    def is_on(self, effect: Effect) -> bool:
        """Return whether an effect is simulated."""
        return next(row.on for row in self.effects if row.effect is effect)

    @property
    def switches(self) -> tuple[tuple[Effect, bool], ...]:
        """Every effect that was decided, as a scene has them."""
        return tuple((row.effect, row.on) for row in self.effects)

    def left_out(self, output: Output) -> float:
        """Return the sum of what all that is left out costs an output."""
        return sum((row.costs or {}).get(output, 0.0) for row in self.effects if not row.on)

    @property
    def estimated_error(self) -> float:
        """Sum of the estimated errors of F_z of what is left out."""
        return sum(row.estimated_error or 0.0 for row in self.effects if not row.on)

    def as_json(self) -> list[dict[str, Any]]:
        """Return the rows for ``--json``."""
        return [
            {
                "name": row.effect.value,
                "on": row.on,
                "reason": row.reason,
                "estimated_error": row.estimated_error,
                "costs": None
                if row.costs is None
                else {output.value: cost for output, cost in row.costs.items()},
                "asked": row.asked,
            }
            for row in self.effects
        ]


_SELF_CONTACT_DEPTH_SHARE = 0.6
_CANNOT_BE_ADDED = {
    Effect.SELF_CONTACT: "leave it off: gel against gel is not simulated",
    Effect.SECOND_LAYER: "give the layers",
    Effect.SYMMETRY: "centre the indenter and move it within one middle plane of the pad",
    Effect.VISCOELASTICITY: "give the material a Prony series",
    Effect.FRICTION: "ask for --contact friction:MU",
}

# Whether a scene has an effect, and the reason.
_Decision = tuple[bool, str]


def full_plan(scene: Scene) -> EffectPlan:
    """Return the plan that leaves nothing out but what the user switches off.

    Raises:
        ConfigError: The user switched something on that cannot be.
    """
    rows = {}
    for effect, decide in _DECIDED.items():
        on, reason = decide(scene)
        # What leaves finite strain out is the law that was asked for.
        asked = effect is Effect.FINITE_STRAIN and not on
        # What is not there costs nothing; what the rest would, nobody has tried yet.
        costs: dict[Output, float] | None = None if on else {}
        rows[effect] = PlannedEffect(effect=effect, on=on, reason=reason, costs=costs, asked=asked)
    for effect, on in scene.effects:
        called = rows[effect]
        if on and not called.on and effect in _CANNOT_BE_ADDED:
            raise ConfigError(
                f"effect {effect.value} cannot be switched on: {called.reason}",
                remedy=_CANNOT_BE_ADDED[effect],
            )
        if on != called.on:
            reason = f"switched by the user; {called.reason}"
            called = replace(called, on=on, reason=reason, costs=None)
        rows[effect] = replace(called, asked=True)
    return EffectPlan(effects=tuple(rows[effect] for effect in Effect))


def _inertia(scene: Scene) -> _Decision:
    period = estimates.slowest_period(scene)
    return (
        True,
        f"the slowest period is {period * 1e3:.2g} ms, the press takes {scene.duration_s:g} s",
    )


def _gravity(scene: Scene) -> _Decision:
    return True, f"rho g H / E of the softest material is {estimates.weight_scale(scene):.2g}"


def _friction(scene: Scene) -> _Decision:
    if scene.contact is not ContactMode.FRICTION or scene.friction == 0.0:
        return False, f"the contact is {scene.contact.value}"
    return True, f"mu is {scene.friction:g}"


def _finite_strain(scene: Scene) -> _Decision:
    if LawName.LINEAR in {material.law for material in scene.materials}:
        return False, "the law is linear"
    share = estimates.expected_depth(scene) / scene.pad.height_m
    return True, f"depth is {share:.1%} of the pad's thickness"


def _locking(scene: Scene) -> _Decision:
    if scene.preset is Preset.PAPER:
        return False, "preset paper has the paper's linear tetrahedra, which lock"
    poisson = max(material.poisson for material in scene.materials)
    return True, f"nu is {poisson:g}; linear tetrahedra lock above 0.4 and are poor below"


def _layers(scene: Scene) -> _Decision:
    if len(scene.layers) > 1:
        return True, f"the gel has {len(scene.layers)} layers"
    return False, "the gel is of one material"


def _relaxation(scene: Scene) -> _Decision:
    if not any(material.relaxation for material in scene.materials):
        return False, "the material has no Prony series"
    return True, f"force above the slow modulus's at the end of {scene.duration_s:g} s"


def _self_contact(scene: Scene) -> _Decision:
    share = estimates.expected_depth(scene) / scene.pad.height_m
    convex = isinstance(scene.indenter, Cylinder | Sphere | Plane)
    if convex and share <= _SELF_CONTACT_DEPTH_SHARE:
        return False, "a convex pad under one convex indenter cannot touch itself"
    return False, "gel against gel is not simulated; min det F and the gap tell where it matters"


def _symmetry(scene: Scene) -> _Decision:
    if mirrors(scene).copies > 1:
        return True, "pad, indenter and motion are mirrored: a quarter or half is solved"
    return False, "no plane mirrors pad, indenter, motion and mesh"


_DECIDED = {
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
