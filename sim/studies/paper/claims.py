"""What the paper states, the rules that ours is judged by, and whether it agrees with itself."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from importlib import resources
from math import isfinite
from typing import NamedTuple

from pydantic import TypeAdapter

from tacauchy_rig.core.errors import ConfigError


class Rule(StrEnum):
    """How ours is judged, as ``rules.toml`` says."""

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
    """A rule's numbers; ``rules.toml`` says what each means."""

    tolerance: float
    is_share: bool = False
    higher_is_better: bool | None = None
    better_factor: float = 1.0
    text: str


def _text(file: str) -> str:
    return resources.files("sim.studies.paper").joinpath(file).read_text("utf-8")


RULES = TypeAdapter(dict[Rule, Judging]).validate_python(tomllib.loads(_text("rules.toml")))


def verdict(rule: Rule, paper: float, ours: float | None) -> Verdict:
    """Return what a number of ours makes of the paper's; None: there is none of ours."""
    if ours is None or not isfinite(ours):
        return Verdict.NOT_REPRODUCED
    judging = RULES[rule]
    room = judging.tolerance * (abs(paper) if judging.is_share else 1.0)
    if judging.higher_is_better is None:
        return Verdict.REPRODUCED if abs(ours - paper) <= room else Verdict.DIFFERENT
    if judging.higher_is_better:
        is_better, worse = ours > judging.better_factor * paper + room, paper - ours
    else:
        is_better, worse = ours * judging.better_factor < paper - room, ours - paper
    if is_better:
        return Verdict.BETTER
    # One-sided rules take any number on the better side.
    return Verdict.REPRODUCED if worse <= room else Verdict.DIFFERENT


# What a correlation and SSIM can be at most, and what a PSNR of 8-bit images is below [dB]: one
# value in a million off by one grey level.
_BOUNDS = {Rule.SCORE: (-1.0, 1.0), Rule.DECIBEL: (0.0, 110.0), Rule.CRITERIA: (1.0, 1.0)}
_BOUNDS_ELSE = (0.0, float("inf"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """One number of the paper."""

    where: str  # section, figure or equation
    says: str  # what it is of
    value: float  # in ``unit``
    rule: Rule
    unit: str = ""
    words: str = ""  # in place of a number; ``value`` is then what would have to hold
    out_of_scope: bool = False  # nothing of ours is meant to do it
    name: str = ""  # section and key of the file, such as ``mesh.tets``


@cache
def claims() -> dict[str, Claim]:
    """Return the paper's numbers by name, in the order of the file."""
    return claims_of(_text("claims.toml"))


def claims_of(text: str) -> dict[str, Claim]:
    """Read claims from TOML."""
    read = TypeAdapter(dict[str, dict[str, Claim]]).validate_python(tomllib.loads(text))
    found = {
        f"{section}.{key}": replace(claim, name=f"{section}.{key}")
        for section, rows in read.items()
        for key, claim in rows.items()
    }
    for name, claim in found.items():
        low, high = _BOUNDS.get(claim.rule, _BOUNDS_ELSE)
        if not isfinite(claim.value) or not low <= claim.value <= high:
            raise ConfigError(
                f"{name}: {claim.value:g} {claim.unit} is no {claim.rule.value}",
                remedy=f"it lies between {low:g} and {high:g}",
            )
    return found


class Check(NamedTuple):
    """One number of the paper, and what its others make of it."""

    says: str
    stated: float
    follows: float
    room: float  # how far rounding alone may part them, as a share

    @property
    def agrees(self) -> bool:
        """The two are the same but for rounding."""
        return abs(self.follows - self.stated) <= self.room * abs(self.stated)


def checks() -> tuple[Check, ...]:
    """Return what can be checked."""
    of = {name: claim.value for name, claim in claims().items()}
    coarse, fine, physics = of["mesh.edge_plain"], of["mesh.edge"], of["speed.physics"]
    # Edges are stated to 0.005 mm either way.
    rounding = 2.0 * (0.005 / coarse + 0.005 / fine)
    density = (coarse / fine) ** 2
    growth, psnr = (
        of["mesh.tets"] / of["mesh.tets_plain"],
        10.0 * math.log10(255.0**2 / of["ends.mse_least"]),
    )
    faces, many = 2.0 * of["mesh.surface_vertices"] - 4.0, 60.0 * of["speed.sixty_each"]
    single, each = (min(physics, 1e3 / of[f"speed.{name}"]) for name in ("single", "sixty_each"))
    step = "physics of a step [ms]: at most a frame of"
    return (
        Check("faces of a closed surface: 2 vertices - 4", of["mesh.surface_faces"], faces, 0.0),
        Check("growth: refined over not refined tetrahedra", of["mesh.growth"], growth, 0.005),
        Check("density: square of the ratio of edges", of["mesh.density"], density, rounding),
        Check("frames/s of 60 environments from those of each", of["speed.sixty"], many, 0.001),
        Check("PSNR at the least MSE [dB]", of["ends.psnr_db_first"], psnr, 0.001),
        Check(f"{step} one environment", physics, single, 0.001),
        Check(f"{step} 60 environments", physics, each, 0.001),
    )
