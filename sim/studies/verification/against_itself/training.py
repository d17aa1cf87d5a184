"""The scenes that chose the estimate's factor of safety, and the factor that each calls for."""

from __future__ import annotations

from collections.abc import Sequence

from sim.force_error_estimate import CHANCE_RELATIVE, SAFETY_FACTOR, error_order, richardson_error
from sim.studies.verification.against_itself.refined_press import (
    NamedScene,
    RefinedPress,
    refined_press,
)
from sim.studies.verification.scenes import TRAINING
from tacauchy_rig.tables import Table


def needed_factor(press: RefinedPress) -> float:
    """Return the factor of safety that just covers a press's true error."""
    order = error_order(press.named.scene)
    found = richardson_error(press.force_n, press.coarser, order=order)
    return max(0.0, press.true_error - CHANCE_RELATIVE) / found


def measure(scenes: Sequence[NamedScene] = TRAINING) -> Table:
    """Press every training scene on four meshes; minutes."""
    found = [refined_press(named) for named in scenes]
    needed = [needed_factor(press) for press in found]
    return Table(
        title="Scenes that chose the factor of safety",
        columns=("scene", "F_z [N]", "F_z, edges half as long [N]", "true error", "factor needed"),
        rows=tuple(
            (press.named.name, press.force_n, press.finer_n, press.true_error, factor)
            for press, factor in zip(found, needed, strict=True)
        ),
        criterion=f"the factor of safety, {SAFETY_FACTOR:g}, covers every scene",
        passed=max(needed) <= SAFETY_FACTOR,
        note=(
            "the finer mesh still has an error of its own, at order 1 as large as the difference; "
            "that is why the factor is larger than the largest that is needed"
        ),
    )
