"""A section of the verification: what was measured, beside its criterion."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A table of the verification's page.

    Attributes:
        columns: Titles of the columns, each with its unit in brackets.
        rows: Cells in the order of ``columns``; None where there is nothing to say.
        criterion: What has to hold, in words.
        passed: It held; true where nothing was demanded.
        note: What a reader has to know to judge the numbers.
        command: A ``tacauchy-rig`` command that gives one of the rows; empty where none does.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float | None, ...], ...]
    criterion: str
    passed: bool
    note: str = ""
    command: str = ""
