"""Presses of objects: what the camera showed, what was simulated, and what no contact scores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from reports.arrays import ColorImage
from reports.evidence.evidence import RunEvidence, TrialEvidence, TrialImages
from reports.scores.metrics import ImageScores, score
from tacauchy_rig.core.errors import RecordError


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectPress:
    """One press of an object.

    Attributes:
        trial: Of the run.
        simulated: Its image, over the press's own no-contact frame if the simulator does so.
        scores: Of that beside the camera's, whole frame, RGB.
        no_contact: Of the camera's own no-contact frame in its place.
    """

    trial: TrialEvidence
    indenter: str
    images: TrialImages
    simulated: ColorImage
    scores: ImageScores
    no_contact: ImageScores


def object_presses(
    evidence: RunEvidence, indenters: Mapping[int, str], simulated: Mapping[int, ColorImage]
) -> list[ObjectPress]:
    """Score every press that has an image of both, in the order of objects' first presses.

    Args:
        indenters: By trial, as ``press --indenter`` has them.
        simulated: By trial.

    Raises:
        RecordError: There is none, or an image has another size.
    """
    presses = [
        ObjectPress(
            trial=trial,
            indenter=indenters[trial.index],
            images=trial.images,
            simulated=simulated[trial.index],
            scores=score(trial.images.real, simulated[trial.index]),
            no_contact=score(trial.images.real, trial.images.reference),
        )
        for trial in evidence.trials
        if trial.images is not None and trial.index in simulated
    ]
    if not presses:
        raise RecordError(
            "no press has both an image of the camera and a simulated one",
            remedy="`tacauchy-rig replay RUN` makes them; --ours takes a simulator's folder",
        )
    order = list(dict.fromkeys(press.indenter for press in presses))
    return sorted(presses, key=lambda press: order.index(press.indenter))
