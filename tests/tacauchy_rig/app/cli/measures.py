"""What the cases of a study measure; a module of its own, as their processes import all of it."""

import os
import time

from tacauchy_rig.core.errors import ConvergenceError


def two() -> dict[str, float]:
    """Measure a number that is small enough."""
    return {"number": 2.0}


def nine() -> dict[str, float]:
    """Measure one that is not."""
    return {"number": 9.0}


def raises() -> None:
    """Go wrong as a press does."""
    raise ConvergenceError("the press stopped at 3.1 mm", remedy="press less")


def crashes() -> None:
    """End the process."""
    os.abort()


def hangs() -> None:
    """Never come to an end."""
    time.sleep(600)


def interrupted() -> None:
    """Be stopped by a person."""
    raise KeyboardInterrupt


_COUNTS: list[int] = []


def count() -> int:
    """Return how often this was called in its process."""
    _COUNTS.append(1)
    return len(_COUNTS)
