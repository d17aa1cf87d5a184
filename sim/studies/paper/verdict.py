"""Verdicts on a number of the paper beside ours, by rules that are stated here."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import isfinite


class Rule(StrEnum):
    """How ours is judged; ``RULES`` has the tolerances."""

    COUNT = "count"
    AT_MOST = "at most"
    AT_LEAST = "at least"
    TIME = "time"
    SCORE = "score"
    DECIBEL = "decibel"
    SQUARES = "squares"
    CRITERIA = "criteria"


class Verdict(StrEnum):
    """What became of a claim."""

    REPRODUCED = "reproduced"
    BETTER = "better"
    DIFFERENT = "different"
    NOT_REPRODUCED = "not reproduced"
    OUT_OF_SCOPE = "out of scope"


@dataclass(frozen=True, slots=True, kw_only=True)
class Judging:
    """A rule's numbers.

    Attributes:
        tolerance: So far from the paper's number ours may be, on the worse side too.
        is_share: The tolerance is a share of the paper's number; else in its unit.
        higher_is_better: False where lower is; None where there is no better.
        better_factor: A better number of another machine has to be so many times better.
        text: What it asks, for the page.
    """

    tolerance: float
    is_share: bool = False
    higher_is_better: bool | None = None
    better_factor: float = 1.0
    text: str


# The paper's GPU is an RTX 5090 (1.79 TB/s by its data sheet), ours an H200 (4.8 TB/s): 2.7 times
# the bandwidth, which is what a batch is made of. Beyond that it is the method.
_MACHINE_FACTOR = 3.0
# Two runs of fTetWild with one setting gave 1,369 and 1,357, 866 and 836 tetrahedra: up to 4 %.
_MESHER_SHARE = 0.05
# What a second repeat of a real press changes: SSIM 0.01 to 0.02, and the noise
# of one frame against its median about 1 dB at the paper's 22 dB.
_SCORE, _DECIBEL = 0.01, 1.0
# 1 dB of PSNR is a factor of 1.26 in MSE.
_SQUARES_SHARE = 0.26

RULES = {
    Rule.COUNT: Judging(
        tolerance=_MESHER_SHARE,
        is_share=True,
        text=f"within {_MESHER_SHARE:.0%}, as two runs of fTetWild differ by up to 4 %",
    ),
    Rule.AT_MOST: Judging(
        tolerance=0.0, higher_is_better=False, better_factor=float("inf"), text="at most the limit"
    ),
    Rule.AT_LEAST: Judging(
        tolerance=0.0,
        higher_is_better=True,
        better_factor=_MACHINE_FACTOR,
        text=f"at least the paper's; better from {_MACHINE_FACTOR:g} times it, since the machine "
        "is another",
    ),
    Rule.TIME: Judging(
        tolerance=0.0,
        higher_is_better=False,
        better_factor=_MACHINE_FACTOR,
        text=f"at most the paper's; better below 1/{_MACHINE_FACTOR:g} of it, since the machine is "
        "another",
    ),
    Rule.SCORE: Judging(tolerance=_SCORE, higher_is_better=True, text=f"within {_SCORE:g}"),
    Rule.DECIBEL: Judging(tolerance=_DECIBEL, higher_is_better=True, text=f"within {_DECIBEL:g}"),
    Rule.SQUARES: Judging(
        tolerance=_SQUARES_SHARE,
        is_share=True,
        higher_is_better=False,
        text=f"within {_SQUARES_SHARE:.0%}, which is 1 dB of PSNR",
    ),
    Rule.CRITERIA: Judging(tolerance=0.0, text="every criterion of the contact mode is met"),
}


def verdict(rule: Rule, paper: float, ours: float | None) -> Verdict:
    """Return what a number of ours makes of the paper's; None: there is none of ours."""
    if ours is None or not isfinite(ours):
        return Verdict.NOT_REPRODUCED
    judging = RULES[rule]
    if _is_better(judging, paper, ours):
        return Verdict.BETTER
    room = judging.tolerance * (abs(paper) if judging.is_share else 1.0)
    worse = ours - paper if judging.higher_is_better is not True else paper - ours
    # One-sided rules take any number on the better side; the others both sides.
    apart = abs(ours - paper) if judging.higher_is_better is None else worse
    return Verdict.REPRODUCED if apart <= room else Verdict.DIFFERENT


def _is_better(judging: Judging, paper: float, ours: float) -> bool:
    if judging.higher_is_better is None:
        return False
    room = judging.tolerance * (abs(paper) if judging.is_share else 1.0)
    if judging.higher_is_better:
        return ours > judging.better_factor * paper + room
    return ours * judging.better_factor < paper - room
