"""Two threads at one image: what its bands need is native code, which needs no interpreter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

Task = Callable[[], None]


class TwoThreads:
    """The caller's thread and another one beside it."""

    def __init__(self) -> None:
        self._other = ThreadPoolExecutor(max_workers=1, thread_name_prefix="rendering")

    def run(self, ours: Sequence[Task], theirs: Sequence[Task]) -> None:
        """Do two rows of tasks side by side; return when all are done."""
        waiting = self._other.submit(_in_turn, theirs)
        try:
            _in_turn(ours)
        finally:
            waiting.result()


def _in_turn(tasks: Sequence[Task]) -> None:
    for task in tasks:
        task()
