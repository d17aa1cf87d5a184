"""What a scene is simulated with, and why: the data of a plan."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from sim.scene.scene import Effect, Output


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
