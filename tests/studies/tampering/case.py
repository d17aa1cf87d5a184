"""One way to tamper with a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tests.studies.tampering.copy import Care, Json, RunCopy

VICTIM, OTHER = 1, 2
"""Trials that are tampered with, and that things are taken from."""

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
    change: Callable[[RunCopy], object]
    cares: tuple[Care, ...] = ALL


def cases_of(
    file: str,
    table: Mapping[str, Any],
    apply: Callable[[RunCopy, Any], object] = lambda copy, change: change(copy),
    *,
    cares: tuple[Care, ...] = ALL,
) -> Iterator[TamperCase]:
    """Yield a case for each row of a table.

    Args:
        file: What is tampered with.
        table: What is done to it, in words, and what does it.
        apply: Does a row's change to a copy; left out, the change takes the copy itself.
        cares: How far the cases are worth being followed up.
    """
    for what, change in table.items():
        done = partial(_apply, apply, change)
        yield TamperCase(name=f"{file}: {what}", change=done, cares=cares)


def json_cases(
    file: str, path: Callable[[RunCopy], Path], table: Mapping[str, Callable[[Json], Json]]
) -> Iterator[TamperCase]:
    """Yield a case for each row that gives fields of a JSON file another value."""
    return cases_of(file, table, lambda copy, fields: copy.change_json(path(copy), fields))


def byte_cases(
    file: str, path: Callable[[RunCopy], Path], table: Mapping[str, Callable[[bytes], bytes]]
) -> Iterator[TamperCase]:
    """Yield a case for each row that destroys a file."""

    def rewrite(copy: RunCopy, change: Callable[[bytes], bytes]) -> None:
        path(copy).write_bytes(change(path(copy).read_bytes()))

    return cases_of(file, table, rewrite, cares=TORN)


def _apply(apply: Callable[[RunCopy, Any], object], change: Any, copy: RunCopy) -> None:
    apply(copy, change)
