"""A criterion of what a run says in two places, and files against the hashes that they had."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from tacauchy_rig.core.run import Criterion
from tacauchy_rig.core.store.run_files import file_sha256, is_inside

TRIAL = "TRIAL"
"""In a remedy, where the trial's number goes."""
SET_ASIDE = (
    "the file was edited, exchanged or damaged after it was written. "
    f"`tacauchy-rig resume RUN --again {TRIAL}` presses the trial once more"
)
RECOVER = "`tacauchy-rig recover RUN` repairs what can be repaired of it; " + SET_ASIDE
_WRITTEN_OUT = 3
"""Contradictions that are written out; one edit often breaks many lines."""
_SHOWN_HASH = 12
"""Digits of a hash that are written out: 48 bits, and the file has the rest."""


def consistency(
    name: str, condition: str, contradictions: Iterable[str], *, remedy: str = SET_ASIDE
) -> Criterion:
    """Return a criterion that is met where nothing contradicts a condition.

    Args:
        name: Of the criterion, such as ``recording_hash``.
        condition: What has to hold, in words.
        contradictions: Each names the file and both values.
        remedy: What to do where it does not hold.
    """
    found = list(contradictions)
    logged = "; ".join(found[:_WRITTEN_OUT])
    more = f"; and {len(found) - _WRITTEN_OUT} more" if len(found) > _WRITTEN_OUT else ""
    return Criterion(
        name=name,
        passed=not found,
        measured=float(len(found)),
        limit=f"{condition}; but {logged}{more}" if found else condition,
        unit="wrong",
        remedy=remedy if found else "",
    )


def hash_mismatch(folder: Path, file: str, *known: object, name: str = "") -> Iterator[str]:
    """Yield that a file is missing, or is none of those that are known.

    Args:
        folder: Where it lies; what leads out of it is not read.
        file: The file within it.
        known: SHA-256 that it may have, the newest last.
        name: What it is called; left out, its own name.
    """
    path = folder / file
    if not is_inside(file):
        yield f"{file!r} is no name of a file of the run"
        return
    if not path.is_file():
        yield f"{name or path.name} is missing"
        return
    found = file_sha256(path, what="a file of the run")
    if found not in known:
        now, before = short_hash(found), short_hash(known[-1])
        yield f"{name or path.name} has the sha256 {now}, and had {before}"


def short_hash(sha256: object) -> str:
    """Return a hash as it is written out."""
    return str(sha256 or "none")[:_SHOWN_HASH]
