"""A budget of standard uncertainties and what its terms come to (GUM 5.1, G.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from scipy.stats import t as student

CONFIDENCE = 0.95


class TermGroup(StrEnum):
    """Where an uncertainty enters, after ASME V&V 20."""

    NUMERICS = "numerics"
    INPUTS = "inputs"
    DATA = "data"


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertaintyTerm:
    """One line of the budget.

    Attributes:
        value_n: Standard uncertainty of the force [N]; None when nobody has measured it.
        degrees_of_freedom: None where its uncertainty is taken as known.
        basis: How the value is known, or why it is not.
    """

    name: str
    group: TermGroup
    value_n: float | None
    basis: str
    degrees_of_freedom: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Combined:
    """What the known terms of a budget come to.

    Attributes:
        value_n: Root sum of squares, u_val of ASME V&V 20 [N].
        degrees_of_freedom: After Welch and Satterthwaite; None where no term has any.
        expanded_n: Half width of the 95 % interval, by Student's t of them [N].
        largest: Name of the term that pays most to reduce.
        without_largest_n: What ``value_n`` would be without it [N].
    """

    value_n: float
    degrees_of_freedom: float | None
    expanded_n: float
    largest: str
    without_largest_n: float


def combine(terms: Sequence[UncertaintyTerm]) -> Combined | None:
    """Combine the known terms of a budget; None where there is none."""
    known = [(term, term.value_n) for term in terms if term.value_n is not None]
    total = math.hypot(*(value for _, value in known))
    if total == 0.0:
        return None
    spent = sum(
        (value / total) ** 4 / term.degrees_of_freedom
        for term, value in known
        if term.degrees_of_freedom
    )
    freedom = 1.0 / spent if spent else math.inf
    largest, _ = max(known, key=lambda pair: pair[1])
    others = (value for term, value in known if term is not largest)
    return Combined(
        value_n=total,
        degrees_of_freedom=freedom if math.isfinite(freedom) else None,
        expanded_n=total * float(student.ppf(0.5 + 0.5 * CONFIDENCE, freedom)),
        largest=largest.name,
        without_largest_n=math.hypot(*others),
    )
