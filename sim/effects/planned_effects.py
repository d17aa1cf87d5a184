"""Effects that a scene calls for by its definition alone, and the data of a plan.

``sim.effects.effect_choice`` tries the effects that stay open on coarse meshes.
"""

from dataclasses import dataclass, field
from typing import Any

from sim.effects import depth_and_inertia_scales as estimates
from sim.effects.mesh_choice import mirrors
from sim.scene.indenter import Cylinder, Plane, Sphere
from sim.scene.material import LawName
from sim.scene.scene import ContactMode, Effect, Output, Preset, Scene
from tacauchy_rig.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedEffect:
    """One row of a plan."""

    effect: Effect
    on: bool  # it is simulated
    reason: str  # why, with the numbers
    # Relative error of each output if it is left out; empty where it changes nothing, None where
    # nobody knows
    costs: dict[Output, float] | None = None
    asked: bool = False  # the user switched it

    @property
    def estimated_error(self) -> float | None:
        """Relative error of the force (or of the depth that it asks for) if it is left out."""
        if self.costs is None:
            return None
        return max(self.costs.get(Output.FORCE, 0.0), self.costs.get(Output.DEPTH, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectPlan:
    """What is simulated of a scene, and why."""

    rows: dict[Effect, PlannedEffect]
    # Relative error of each output that is asked for that all effects left out may have together
    tolerances: dict[Output, float] = field(default_factory=dict)
    tried_s: float = 0.0  # processor time of the coarse presses that it rests on [s]

    def is_on(self, effect: Effect) -> bool:
        """Return whether an effect is simulated."""
        return self.rows[effect].on

    @property
    def switches(self) -> tuple[tuple[Effect, bool], ...]:
        """Every effect that was decided, as a scene has them."""
        return tuple((row.effect, row.on) for row in self.rows.values())

    def left_out(self, output: Output) -> float:
        """Return the sum of what all that is left out costs an output."""
        return sum((row.costs or {}).get(output, 0.0) for row in self.rows.values() if not row.on)

    @property
    def estimated_error(self) -> float:
        """Sum of the estimated errors of F_z of what is left out."""
        return sum(row.estimated_error or 0.0 for row in self.rows.values() if not row.on)

    def as_json(self) -> list[dict[str, Any]]:
        """Return the rows for ``--json``."""
        names = ("on", "reason", "estimated_error", "costs", "asked")
        return [
            {"name": effect.value, **{name: getattr(row, name) for name in names}}
            for effect, row in self.rows.items()
        ]


_SELF_CONTACT_DEPTH_SHARE = 0.6
_CANNOT_BE_ADDED = {
    Effect.SELF_CONTACT: "leave it off: gel against gel is not simulated",
    Effect.SECOND_LAYER: "give the layers",
    Effect.SYMMETRY: "centre the indenter and move it within one middle plane of the pad",
    Effect.VISCOELASTICITY: "give the material a Prony series",
    Effect.FRICTION: "ask for --contact friction:MU",
}


def full_plan(scene: Scene) -> EffectPlan:
    """Return the plan that leaves nothing out but what the user switches off.

    Raises:
        ConfigError: The user switched something on that cannot be.
    """
    rows, switched = {}, dict(scene.effects)
    for effect, (called_for, reason) in _decisions(scene).items():
        on = switched.get(effect, called_for)
        if on and not called_for and effect in _CANNOT_BE_ADDED:
            raise ConfigError(
                f"effect {effect.value} cannot be switched on: {reason}",
                remedy=_CANNOT_BE_ADDED[effect],
            )
        rows[effect] = PlannedEffect(
            effect=effect,
            on=on,
            reason=reason if on == called_for else f"switched by the user; {reason}",
            # What is not there costs nothing; what the rest would, nobody has tried yet.
            costs=None if on or called_for else {},
            # What leaves finite strain out is the law that was asked for.
            asked=effect in switched or (effect is Effect.FINITE_STRAIN and not called_for),
        )
    return EffectPlan(rows=rows)


def _decisions(scene: Scene) -> dict[Effect, tuple[bool, str]]:
    """Return whether a scene has each effect, and the reason."""
    period_ms = 1e3 * estimates.slowest_period(scene)
    depth_share = estimates.expected_depth(scene) / scene.pad.height_m
    poisson = max(material.poisson for material in scene.materials)
    is_convex = isinstance(scene.indenter, Cylinder | Sphere | Plane)
    folds = not is_convex or depth_share > _SELF_CONTACT_DEPTH_SHARE
    weight = estimates.weight_scale(scene)
    rubs = scene.contact is ContactMode.FRICTION and scene.friction != 0.0
    # With each effect the reason why it is simulated, and the one why it is not.
    called_for = {
        Effect.INERTIA: (
            True,
            f"the slowest period is {period_ms:.2g} ms, the press takes {scene.duration_s:g} s",
            "",
        ),
        Effect.GRAVITY: (True, f"rho g H / E of the softest material is {weight:.2g}", ""),
        Effect.FRICTION: (rubs, f"mu is {scene.friction:g}", f"the contact is {scene.contact}"),
        Effect.FINITE_STRAIN: (
            LawName.LINEAR not in {material.law for material in scene.materials},
            f"depth is {depth_share:.1%} of the pad's thickness",
            "the law is linear",
        ),
        Effect.LOCKING_FREE_ELEMENT: (
            scene.preset is not Preset.PAPER,
            f"nu is {poisson:g}; linear tetrahedra lock above 0.4 and are poor below",
            "preset paper has the paper's linear tetrahedra, which lock",
        ),
        Effect.SECOND_LAYER: (
            len(scene.layers) > 1,
            f"the gel has {len(scene.layers)} layers",
            "the gel is of one material",
        ),
        Effect.VISCOELASTICITY: (
            any(material.relaxation for material in scene.materials),
            f"force above the slow modulus's at the end of {scene.duration_s:g} s",
            "the material has no Prony series",
        ),
        Effect.SELF_CONTACT: (
            False,
            "",
            "gel against gel is not simulated; min det F and the gap tell where it matters"
            if folds
            else "a convex pad under one convex indenter cannot touch itself",
        ),
        Effect.SYMMETRY: (
            mirrors(scene).copies > 1,
            "pad, indenter and motion are mirrored: a quarter or half is solved",
            "no plane mirrors pad, indenter, motion and mesh",
        ),
    }
    return {
        effect: (on, why if on else why_not) for effect, (on, why, why_not) in called_for.items()
    }
