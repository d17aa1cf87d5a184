"""How far a value of ``rig.toml`` may go on any rig, and why.

A value may be well formed and still be one that no arm, cell or gel can honour: a limit so wide
that it never stops anything is refused here, not met on the rig. What depends on the run's gel is
in ``tacauchy_rig.app.session.gel_limits``; what ties two fields together in
``tacauchy_rig.core.config.rules``.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from types import MappingProxyType

from pydantic import TypeAdapter

from tacauchy_rig.core.quantities import Dimension, parse_quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class Ceiling:
    """The range of one field.

    Attributes:
        least: Smallest value, as it is written; None where the field's type is enough.
        most: Largest value, likewise.
        because: Reason, as a clause that follows a semicolon.
    """

    dimension: Dimension
    because: str
    least: str | None = None
    most: str | None = None

    def crossed(self, value: float) -> tuple[str, float] | None:
        """Return ``"le"`` or ``"ge"`` and the bound [SI] that ``value`` [SI] is beyond, if any."""
        for name, bound, sign in (("le", self.most, 1.0), ("ge", self.least, -1.0)):
            if bound is not None:
                limit = parse_quantity(bound, dimension=self.dimension)
                if sign * value > sign * limit:
                    return name, limit
        return None


def _read() -> Mapping[str, Mapping[str, Ceiling]]:
    text = resources.files("tacauchy_rig.core.config").joinpath("ceilings.toml").read_text("utf-8")
    tables = tomllib.loads(text)
    return TypeAdapter(dict[str, dict[str, Ceiling]]).validate_python(tables)


CEILINGS = _read()
"""By table and field, in the order of the file."""

NO_CEILINGS: Mapping[str, Ceiling] = MappingProxyType({})


def ceilings() -> Iterator[tuple[str, Ceiling]]:
    """Yield dotted field and range, in the order of the file."""
    for table, fields in CEILINGS.items():
        for field, ceiling in fields.items():
            yield f"{table}.{field}", ceiling
