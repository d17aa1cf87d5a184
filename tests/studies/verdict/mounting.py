"""What it is worth to simulate friction and the lean that a run tells."""

from __future__ import annotations

from dataclasses import dataclass, replace

from reports.comparison.compare import compare
from tacauchy_rig.app.replay.optics import Say
from tacauchy_rig.core.tables import Table
from tests.studies.verdict.bench import Bench

FOUND, UPRIGHT, SMOOTH = "as found", "upright", "upright, no friction"
BEATEN_SHARE = 5.0 / 6.0
"""Of the trials that have to come out better, so that noise in one does not decide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Residuals:
    """Of one trial: what of the contact's change each replay leaves unexplained [1].

    Attributes:
        left: By the replay's name; None where the image shows no contact.
    """

    trial: int
    force_n: float
    left: dict[str, float | None]

    @property
    def is_better(self) -> bool:
        """Friction and lean as found leave less than neither."""
        found, smooth = self.left[FOUND], self.left[SMOOTH]
        return found is not None and smooth is not None and found < smooth


def residuals_of(bench: Bench, say: Say) -> list[Residuals]:
    """Replay a run as found, upright, and upright without friction, each with its own modulus."""
    inputs = bench.inputs
    pressed = {FOUND: bench.pressed}
    for name, other in (
        (UPRIGHT, inputs.upright),
        (SMOOTH, replace(inputs.upright, friction=0.0)),
    ):
        say(f"replaying {name}")
        pressed[name] = bench.press(other)
    judged = {name: compare(bench.evidence(each)).trials for name, each in pressed.items()}
    return [
        Residuals(
            trial=trial.index,
            force_n=trial.force_measured_n or 0.0,
            left={
                name: contact.relative_residual if (contact := trials[k].contact) else None
                for name, trials in judged.items()
            },
        )
        for k, trial in enumerate(judged[FOUND])
    ]


def residual_table(found: list[Residuals]) -> Table:
    """Return a row for each trial."""
    better = sum(each.is_better for each in found)
    names = (FOUND, UPRIGHT, SMOOTH)
    return Table(
        title="Contact residual with and without",
        columns=("trial", "force [N]", *names, "better"),
        rows=tuple(
            (each.trial, each.force_n, *(each.left[name] for name in names), each.is_better)
            for each in found
        ),
        criterion="friction and lean as found leave less of the contact unexplained than neither, "
        "in five of six trials",
        passed=bool(found) and better >= BEATEN_SHARE * len(found),
    )
