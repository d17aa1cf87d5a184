"""Which trials a figure shows, and their forces along its axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeVar

from reports.comparison.result_types import TrialResult
from reports.evidence.evidence_types import TrialEvidence

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_COLUMNS = 6

Trial = TypeVar("Trial", TrialResult, TrialEvidence)
Item = TypeVar("Item")


def shown(trials: Sequence[Trial], *, most: int = MAX_COLUMNS) -> list[Trial]:
    """Pick some trials, evenly spread over the target forces, first and last included.

    Imported ones without a force come last.
    """
    ordered = sorted(
        trials, key=lambda t: (math.isnan(t.force_target_n), t.force_target_n, t.index)
    )
    return spread(ordered, most)


def spread(ordered: list[Item], most: int) -> list[Item]:
    """Return at most so many of a list, evenly spread, its first and last included."""
    if len(ordered) <= most:
        return ordered
    step = (len(ordered) - 1) / (most - 1)
    return [ordered[round(k * step)] for k in range(most)]


def force_label(trial: TrialResult | TrialEvidence) -> str:
    """Return the target force with two decimals, as the paper shows it; the number without one."""
    return f"#{trial.index}" if math.isnan(trial.force_target_n) else f"{trial.force_target_n:.2f}"


def force_title(trial: TrialResult | TrialEvidence, text: str = "{} N") -> str:
    """Return a press's force in a text with its unit; the number alone where it has none."""
    label = force_label(trial)
    return label if math.isnan(trial.force_target_n) else text.format(label)


def label_forces(axes: Axes, trials: Sequence[TrialResult]) -> None:
    """Put the trials' forces under the x axis."""
    axes.set_xticks(range(len(trials)), [force_label(t) for t in trials])
    if len(trials) > 2 * MAX_COLUMNS:
        axes.tick_params(axis="x", labelrotation=90, labelsize=5)
    axes.set_xlabel("Target force $F_z$ (N)")
