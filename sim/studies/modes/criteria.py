"""What the contact modes' signatures are held against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.studies.modes.signatures import ContactSignature

FRICTION = 0.5
SLIDE_STEP_M = 0.2e-3
# A slide has let go where its resultant grows by less than this in a step.
GROWTH_MAX = 5e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeCriterion:
    """One number of a signature against its limit.

    Attributes:
        judged: False where the run did not come to what the number is about; it has then failed.
    """

    name: str
    measured: float
    limit: str
    passed: bool
    judged: bool = True

    @property
    def verdict(self) -> str:
        """The outcome in a word or two."""
        if not self.judged:
            return "not judged"
        return "ok" if self.passed else "MISSED"


def press_criteria(signature: ContactSignature) -> tuple[ModeCriterion, ...]:
    """Judge a straight press."""
    resultant = float(np.linalg.norm(signature.tangential_n[:2])) / signature.normal_size_n
    return (
        _at_least("tangential traction is radial: mean cosine", signature.radial_share, 0.95),
        _below("tangential resultant in the plane over F_n", resultant, 1e-3),
    )


def slide_criteria(
    before: ContactSignature, signature: ContactSignature, growth: float
) -> tuple[ModeCriterion, ...]:
    """Judge a slide's end.

    Args:
        before: Where it began.
        growth: Relative growth of the tangential resultant over F_n in the last step.
    """
    on_indenter = -np.array(signature.tangential_n)
    cosine = float(on_indenter[0] / np.linalg.norm(on_indenter))
    mobilised = signature.mobilised_friction / FRICTION
    settled = abs(growth) <= GROWTH_MAX
    advance = signature.centre_m[0] - before.centre_m[0]
    step = f"{SLIDE_STEP_M * 1e3:g} mm"
    return (
        _below("cosine of summed traction on the indenter and motion", cosine, -0.98),
        ModeCriterion(
            name=f"growth of the tangential resultant in the last {step}",
            measured=growth,
            limit=f"within {GROWTH_MAX:g}",
            passed=settled,
        ),
        ModeCriterion(
            name="tangential resultant over mu F_n where all slides",
            measured=mobilised,
            limit="1 within 0.02",
            passed=settled and abs(mobilised - 1.0) <= 0.02,
            judged=settled,
        ),
        ModeCriterion(
            name="centre of pressure moved towards the leading edge [mm]",
            measured=advance * 1e3,
            limit="> 0",
            passed=advance > 0.0,
        ),
    )


def twist_criteria(signature: ContactSignature) -> tuple[ModeCriterion, ...]:
    """Judge a turn."""
    share = signature.circumferential_share
    return (_at_least("tangential traction is circumferential: mean cosine", share, 0.95),)


def _at_least(name: str, measured: float, limit: float) -> ModeCriterion:
    return ModeCriterion(
        name=name, measured=measured, limit=f">= {limit:g}", passed=measured >= limit
    )


def _below(name: str, measured: float, limit: float) -> ModeCriterion:
    return ModeCriterion(
        name=name, measured=measured, limit=f"< {limit:g}", passed=measured < limit
    )
