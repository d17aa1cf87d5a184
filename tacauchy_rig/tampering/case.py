"""One way to tamper with a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tacauchy_rig.tampering.copy import Care, RunCopy

ALL = tuple(Care)
TORN = (Care.BYTES,)
"""For what destroys a file: it has no right checksums, and nobody who seals leaves it so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TamperCase:
    """A change to a copy of a run.

    Attributes:
        name: Which file, and what is done to it.
        change: Does it; hashes follow as far as the copy's care goes.
        cares: How far it is worth being followed up.
    """

    name: str
    change: Callable[[RunCopy], None]
    cares: tuple[Care, ...] = ALL
