"""The laws by name."""

from __future__ import annotations

from sim.material.laws import linear, neo_hookean, paper_eq4, stable_neo_hookean
from sim.material.laws.tangent import Law
from sim.scene.material import LawName


def law(name: LawName) -> Law:
    """Return a law."""
    return {
        LawName.STABLE_NEO_HOOKEAN: stable_neo_hookean.LAW,
        LawName.NEO_HOOKEAN: neo_hookean.LAW,
        LawName.LINEAR: linear.LAW,
        LawName.PAPER_EQ4: paper_eq4.LAW,
    }[name]
