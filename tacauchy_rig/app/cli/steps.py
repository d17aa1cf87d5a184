"""Steps of a long command: a bar with the seconds left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from tacauchy_rig.app.cli.output import complain, error_console


class Steps:
    """Shows steps as they are done; a context."""

    def __init__(self) -> None:
        self._started = time.monotonic()
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=20),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
            console=error_console,
            transient=True,
            disable=not error_console.is_terminal,
        )
        self._task = self._bar.add_task("", total=None, left="")

    def __enter__(self) -> Steps:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def __call__(self, what: str, done: int, total: int) -> None:
        """Say what was done, and as the how-manieth step of how many."""
        spent_s = time.monotonic() - self._started
        left = f"about {spent_s / done * (total - done):.0f} s left" if 0 < done < total else ""
        if error_console.is_terminal:
            self._bar.update(self._task, description=what, completed=done, total=total, left=left)
        else:
            complain(f"  {done}/{total} {what}{', ' * bool(left)}{left}")
