"""Prony series of a gel: how much of each tetrahedron's stiffness is lost, and how fast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.scene.material import RelaxationTerm
from tacauchy_rig.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class PronySeries:
    """Stiffness E0 (1 - sum of shares) after a long time, E0 at once; E is the one after long.

    Attributes:
        times_s: Time constants, shape [term_count].
        shares: Shares of the instantaneous stiffness that go, shape [term_count, element_count].
    """

    times_s: FloatArray
    shares: FloatArray

    def __post_init__(self) -> None:
        lost = float(self.shares.sum(axis=0).max(initial=0.0))
        if lost >= 1.0:
            raise ConfigError(
                f"relaxation takes {lost:.4g} of the instantaneous stiffness",
                remedy="let the shares of all terms sum to less than 1",
            )

    @property
    def ratios(self) -> FloatArray:
        """Shares in units of the stiffness that stays, shape [term_count, element_count]."""
        return np.asarray(self.shares / (1.0 - self.shares.sum(axis=0)))


def prony_series(
    terms: Sequence[Sequence[RelaxationTerm]], material_of: IntArray
) -> PronySeries | None:
    """Collect the terms of a gel's materials; None where nothing relaxes.

    Args:
        terms: Of each material.
        material_of: Which material each tetrahedron is of, shape [element_count].

    Raises:
        ConfigError: A material loses all of its stiffness.
    """
    times = sorted({term.time_s for material in terms for term in material})
    if not times:
        return None
    table = np.zeros((len(times), len(terms)))
    for material, its_terms in enumerate(terms):
        for term in its_terms:
            table[times.index(term.time_s), material] += term.share
    return PronySeries(times_s=np.array(times), shares=table[:, material_of])
