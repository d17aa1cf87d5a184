"""The estimate of one scene's force error beside its true error, against a mesh twice as fine."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from sim.effects.plan import plan_effects
from sim.force_error_estimate import (
    COARSENINGS,
    CoarserForce,
    ForceErrorEstimate,
    estimate_from,
    force_on,
)
from sim.scene.scene import Scene

logger = logging.getLogger(__name__)

FINER = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedScene:
    """A scene and what it is called in a table."""

    name: str
    scene: Scene


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinedPress:
    """One scene on four meshes.

    Attributes:
        force_n: F_z on the preset's mesh.
        finer_n: F_z on the mesh twice as fine.
    """

    named: NamedScene
    force_n: float
    finer_n: float
    coarser: tuple[CoarserForce, ...]

    @property
    def estimate(self) -> ForceErrorEstimate:
        """What is believed without the finer mesh; both meshes leave out the same effects."""
        return estimate_from(self.named.scene, self.force_n, self.coarser)

    @property
    def true_error(self) -> float:
        """Relative to the finer mesh."""
        return abs(self.force_n / self.finer_n - 1.0)

    @property
    def is_inside(self) -> bool:
        """The true error is not larger than the estimate."""
        estimated = self.estimate.relative
        return estimated is not None and self.true_error <= estimated


def refined_press(named: NamedScene, *, finer: float = FINER) -> RefinedPress:
    """Press a scene to its depth on its own mesh, on two coarser ones and on a finer one.

    Args:
        finer: How many times shorter the finer mesh's edges are.

    Raises:
        RigError: A mesh cannot be made or solved.
    """
    scene, plan = named.scene, plan_effects(named.scene)
    coarser = tuple(
        CoarserForce(ratio=ratio, force_n=force_on(scene, plan, refinement=1.0 / ratio))
        for ratio in COARSENINGS
    )
    found = RefinedPress(
        named=named,
        force_n=force_on(scene, plan, refinement=1.0),
        finer_n=force_on(scene, plan, refinement=finer),
        coarser=coarser,
    )
    logger.info(
        "%s: true error %.3g, believed %.3g",
        named.name,
        found.true_error,
        found.estimate.relative,
    )
    return found
