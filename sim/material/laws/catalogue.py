"""The laws by name."""

from __future__ import annotations

from sim.material.laws.tangent import Law
from tacauchy_rig.registry import Kind, load


def law(name: str) -> Law:
    """Return a law: one of ``LawName``, or one that another package brings.

    Raises:
        ConfigError: There is none of that name, or its package does not import.
    """
    found: Law = load(Kind.LAW, name)
    return found
