"""The laws by name."""

from __future__ import annotations

from enum import StrEnum

from sim.laws import linear, neo_hookean, paper_eq4, stable_neo_hookean
from sim.laws.tangent import Law


class LawName(StrEnum):
    """Names as the command line takes them."""

    STABLE_NEO_HOOKEAN = "stable-neo-hookean"
    NEO_HOOKEAN = "neo-hookean"
    LINEAR = "linear"
    PAPER_EQ4 = "paper-eq4"


def law(name: LawName) -> Law:
    """Return a law."""
    return {
        LawName.STABLE_NEO_HOOKEAN: stable_neo_hookean.LAW,
        LawName.NEO_HOOKEAN: neo_hookean.LAW,
        LawName.LINEAR: linear.LAW,
        LawName.PAPER_EQ4: paper_eq4.LAW,
    }[name]
