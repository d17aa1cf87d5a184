"""What the paper states, read from ``claims.toml`` and held to nothing but its own bounds."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from math import isfinite

from pydantic import TypeAdapter

from sim.studies.paper.verdict import Rule
from tacauchy_rig.core.errors import ConfigError

_FILE = resources.files("sim.studies.paper").joinpath("claims.toml")
# What a correlation and SSIM can be at most, and what a PSNR of 8-bit images is below [dB]: one
# value in a million off by one grey level.
_BOUNDS = {Rule.SCORE: (-1.0, 1.0), Rule.DECIBEL: (0.0, 110.0), Rule.CRITERIA: (1.0, 1.0)}
_BOUNDS_ELSE = (0.0, float("inf"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """One number of the paper.

    Attributes:
        where: Section, figure or equation.
        says: What it is of.
        value: In ``unit``.
        rule: How ours is judged beside it.
        words: What the paper says in place of a number; ``value`` is then what would have to hold.
        out_of_scope: Nothing of ours is meant to do it.
        name: Section and key of the file, such as ``mesh.tets``.
    """

    where: str
    says: str
    value: float
    rule: Rule
    unit: str = ""
    words: str = ""
    out_of_scope: bool = False
    name: str = ""


@cache
def claims() -> dict[str, Claim]:
    """Return the paper's numbers by name, in the order of the file."""
    return claims_of(_FILE.read_text("utf-8"))


def claims_of(text: str) -> dict[str, Claim]:
    """Read claims from TOML.

    Raises:
        ConfigError: A number is outside of what it can be at all.
    """
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
