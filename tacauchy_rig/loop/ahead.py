"""The longest part of a replay while its run is still recorded, by a process beside.

How the gel goes to the largest force depends on nothing that is measured but its modulus, and a
stiffer gel goes on from there (``sim/walk.py``). The process is the last to be served.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Protocol

from sim.walk import Walk
from tacauchy_rig.config.model import RigConfig
from tacauchy_rig.errors import RigError
from tacauchy_rig.loop.optics import Say, say_nothing
from tacauchy_rig.loop.parts import Part
from tacauchy_rig.loop.pressing import Pressed, press_parts, walk_ahead
from tacauchy_rig.side_by_side import beside

_NICE = 19
# Of the process beside: what it walked.
_walks: list[Walk] = []


class Press(Protocol):
    """Presses the parts of a run, as ``press_parts`` does."""

    def __call__(self, parts: Sequence[Part], *, on_progress: Say = say_nothing) -> list[Pressed]:
        """Press, and tell of it."""
        ...


@contextmanager
def pressing_ahead(config: RigConfig) -> Iterator[Press]:
    """Begin to press a run's largest force, and give what goes on from there once it is recorded.

    Where nobody else has a processor to spare for it, or the process is gone, everything is pressed
    when it is asked for.
    """
    if len(os.sched_getaffinity(0)) < 2:
        yield press_parts
        return
    with beside() as other:
        other.submit(_walk, config)
        yield _Beside(other)


class _Beside:
    """Presses in the process that went ahead."""

    def __init__(self, other: Executor) -> None:
        self._other = other

    def __call__(self, parts: Sequence[Part], *, on_progress: Say = say_nothing) -> list[Pressed]:
        """Press there, or here if it is gone."""
        try:
            pressed, said = self._other.submit(_press, parts).result()
        except BrokenProcessPool:
            on_progress("the process that pressed ahead is gone: pressing anew")
            return press_parts(parts, on_progress=on_progress)
        for line in said:
            on_progress(line)
        return pressed


def _walk(config: RigConfig) -> None:
    os.nice(_NICE)
    try:
        walk = walk_ahead(config)
    except RigError:
        return  # pressed again when it is asked for, it says so
    if walk is not None:
        _walks.append(walk)


def _press(parts: Sequence[Part]) -> tuple[list[Pressed], list[str]]:
    """Return what was pressed, and what was said meanwhile."""
    said: list[str] = []
    return press_parts(parts, on_progress=said.append, walks=_walks), said
