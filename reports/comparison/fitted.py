"""What a replay was fitted to, and whether the judged presses are among it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from reports.evidence.evidence import RunEvidence
from tacauchy_rig.core.simulated import ReplayModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """One input of the simulation.

    Attributes:
        what: The input.
        value: What was found or taken of it, with its unit; empty for many numbers.
        source: The data that it was fitted to, or where it was stated.
        in_sample: The judged presses are among these data.
        effect: What that means for the scores.
    """

    what: str
    value: str
    source: str
    in_sample: bool
    effect: str


def fits_of(evidence: RunEvidence) -> tuple[Fit, ...]:
    """Return what the simulation of a run was fitted to; nothing where it was not simulated."""
    model = evidence.model
    return () if model is None else tuple(_fits(model, evidence))


def _fits(model: ReplayModel, evidence: RunEvidence) -> Iterator[Fit]:
    yield _modulus(model)
    yield _optics(model, evidence)
    if model.tilt_deg:
        yield Fit(
            what="Tilt of the indenter",
            value=f"{model.tilt_deg:.2f} deg",
            source="the measured moments of these same presses" if model.found else "stated",
            in_sample=bool(model.found),
            effect="No image was used." if model.found else "",
        )
    if model.found_offset_mm:
        yield Fit(
            what="Place of the indenter",
            value=f"{model.found_offset_mm:.3f} mm from the stated place",
            source="the images of these same presses",
            in_sample=True,
            effect="Image scores are in-sample; the distance counts as contact offset.",
        )


def _modulus(model: ReplayModel) -> Fit:
    if model.modulus_factor is None:
        return Fit(
            what="Modulus of the gel",
            value=f"{1e-3 * model.young_pa:.4g} kPa",
            source="stated, not fitted",
            in_sample=False,
            effect="Depths, images and predicted forces are out of sample.",
        )
    return Fit(
        what="Modulus of the gel",
        value=f"{model.modulus_factor:.3f} times the nominal one",
        source=f"depths and forces of {model.modulus_trials} of these same presses; no images",
        in_sample=True,
        effect="Simulated depths and images use it and are in-sample. Predicted forces use the"
        " nominal modulus and are out of sample.",
    )


def _optics(model: ReplayModel, evidence: RunEvidence) -> Fit:
    source = model.optics.get("source")
    effect = "Image scores are out of sample." if source else "Where they are from is not known."
    if evidence.optics_are_in_sample:
        effect = "Image scores are in-sample."
        if evidence.optics is not None:
            held_out = evidence.optics.nudged
            effect += (
                f" Cross-validated, SSIM around the contact is {held_out.ssim:.4f}"
                f" (no contact {held_out.ssim_no_contact:.4f})."
            )
    return Fit(
        what="Optics (colours)",
        value="",
        source=f"{source or 'not stated'}{', these same presses' * evidence.optics_are_in_sample}",
        in_sample=evidence.optics_are_in_sample,
        effect=effect,
    )
