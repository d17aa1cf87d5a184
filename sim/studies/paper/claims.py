"""What the paper states, the rules that ours is judged by, and whether it agrees with itself."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from math import isfinite
from typing import Any, NamedTuple

from pydantic import TypeAdapter

from sim.studies import from_file
from tacauchy_rig.core.errors import ConfigError


class Verdict(StrEnum):
    """What became of a claim."""

    REPRODUCED = "reproduced"
    BETTER = "better"
    DIFFERENT = "different"
    NOT_REPRODUCED = "not reproduced"
    OUT_OF_SCOPE = "out of scope"


RULES: dict[str, dict[str, Any]] = from_file("paper/rules.toml")
"""By name how ours is judged."""


def verdict(rule: str, paper: float, ours: float | None) -> Verdict:
    """Return what a number of ours makes of the paper's; None: there is none of ours."""
    if ours is None or not isfinite(ours):
        return Verdict.NOT_REPRODUCED
    judging = RULES[rule]
    room = judging["tolerance"] * (abs(paper) if judging["is_share"] else 1.0)
    worse, factor = abs(ours - paper), judging["better_factor"]
    is_better = False
    if judging["better"] == "higher":
        is_better, worse = ours > factor * paper + room, paper - ours
    elif judging["better"] == "lower":
        is_better, worse = ours * factor < paper - room, ours - paper
    if is_better:
        return Verdict.BETTER
    # One-sided rules take any number on the better side.
    return Verdict.REPRODUCED if worse <= room else Verdict.DIFFERENT


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """One number of the paper."""

    where: str  # section, figure or equation
    says: str  # what it is of
    value: float  # in ``unit``
    rule: str  # one of ``RULES``
    unit: str = ""
    words: str = ""  # in place of a number; ``value`` is then what would have to hold
    out_of_scope: bool = False  # nothing of ours is meant to do it
    name: str = ""  # section and key of the file, such as ``mesh.tets``


@cache
def claims() -> dict[str, Claim]:
    """Return the paper's numbers by name, in the order of the file."""
    return claims_of(from_file("paper/claims.toml"))


def claims_of(sections: Mapping[str, Mapping[str, Any]]) -> dict[str, Claim]:
    """Read the claims of a file's sections."""
    named = {f"{name}.{key}": row for name, rows in sections.items() for key, row in rows.items()}
    rows = {name: row | {"name": name} for name, row in named.items()}
    found = TypeAdapter(dict[str, Claim]).validate_python(rows)
    for name, claim in found.items():
        low, high = RULES[claim.rule]["bounds"]
        if not isfinite(claim.value) or not low <= claim.value <= high:
            raise ConfigError(
                f"{name}: {claim.value:g} {claim.unit} is no {claim.rule}",
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
    growth = of["mesh.tets"] / of["mesh.tets_plain"]
    psnr = 10.0 * math.log10(255.0**2 / of["ends.mse_least"])
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
