"""What is wrong with a source: collected, and told all at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import TypeVar

from tacauchy_rig.core.errors import RecordError, RigError

T = TypeVar("T")
SHOWN = 20
"""Lines that are told of one kind of problem; the rest is counted."""


class Problems:
    """Errors that were met while reading went on."""

    def __init__(self) -> None:
        self._found: list[RigError] = []

    def __bool__(self) -> bool:
        return bool(self._found)

    def add(self, message: str, *, remedy: str) -> None:
        """Note a problem; the same one is noted once."""
        self._note(RecordError(message, remedy=remedy))

    def _note(self, error: RigError) -> None:
        if all(str(each) != str(error) for each in self._found):
            self._found.append(error)

    @contextmanager
    def noting(self) -> Iterator[None]:
        """Note an error of what is done within, and go on after it."""
        try:
            yield
        except RigError as error:
            self._note(error)

    def attempt(self, make: Callable[[], T]) -> T | None:
        """Return what is made; None where that ends in an error, which is noted."""
        try:
            return make()
        except RigError as error:
            self._note(error)
            return None

    def refuse(self) -> None:
        """End where there was a problem.

        Raises:
            RigError: As ``all_in_one``.
        """
        if self._found:
            raise self.all_in_one

    @property
    def all_in_one(self) -> RigError:
        """The only problem as it was, or one that lists all."""
        if len(self._found) == 1:
            return self._found[0]
        groups = [
            (remedy, shown([each.message for each in errors]))
            for remedy, errors in groupby(self._found, key=lambda each: each.remedy)
        ]
        told = [f"{lines}\n  -> {remedy}" for remedy, lines in groups[:-1]]
        remedy, last = groups[-1]
        message = "\n".join([f"{len(self._found)} problems", *told, last])
        return RecordError(message, remedy=remedy)


def shown(lines: Sequence[str]) -> str:
    """Return lines as one text, and how many more there are."""
    more = [f"and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else []
    return "\n".join([*lines[:SHOWN], *more])
