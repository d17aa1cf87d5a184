"""A check's outcome as a criterion: what had to agree, and what does not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from tacauchy_rig.core.run import Criterion
from tacauchy_rig.core.store.seals import file_sha256

TRIAL = "TRIAL"
"""In a remedy, where the trial's number goes."""

SET_ASIDE = (
    "the file was edited, exchanged or damaged after it was written. "
    f"`tacauchy-rig resume RUN --again {TRIAL}` presses the trial once more"
)
_TOLD = 3
"""Contradictions that are written out; one edit often breaks many lines."""
_SHOWN_HASH = 12
"""Digits of a hash that are written out: 48 bits, and the file has the rest."""


def agreement(
    name: str, promise: str, contradictions: Iterable[str], *, remedy: str = SET_ASIDE
) -> Criterion:
    """Return a criterion that is met where nothing contradicts a promise.

    Args:
        name: Of the criterion, such as ``recording_hash``.
        promise: What has to hold, in words.
        contradictions: Each names the file and both values.
        remedy: What to do where it does not hold.
    """
    found = list(contradictions)
    told = "; ".join(found[:_TOLD])
    more = f"; and {len(found) - _TOLD} more" if len(found) > _TOLD else ""
    return Criterion(
        name=name,
        passed=not found,
        measured=float(len(found)),
        limit=f"{promise}; but {told}{more}" if found else promise,
        unit="wrong",
        remedy=remedy if found else "",
    )


def unlike(path: Path, *known: object, name: str = "") -> Iterator[str]:
    """Yield that a file is missing, or is none of those that are known.

    Args:
        path: The file.
        known: SHA-256 that it may have, the newest last.
        name: What it is called; left out, its own name.
    """
    if not path.is_file():
        yield f"{name or path.name} is missing"
        return
    found = file_sha256(path, what="a file of the run")
    if found not in known:
        yield f"{name or path.name} has the sha256 {shown(found)}, and had {shown(known[-1])}"


def shown(sha256: object) -> str:
    """Return a hash as it is written out."""
    return str(sha256 or "none")[:_SHOWN_HASH]
