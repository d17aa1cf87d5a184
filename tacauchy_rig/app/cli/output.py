"""What the command line prints: plain lines, progress on a terminal, JSON on request."""

from __future__ import annotations

import json
import logging
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.tables import Table, terminal_table

logger = logging.getLogger(__name__)

console = Console(highlight=False, soft_wrap=True)
error_console = Console(stderr=True, highlight=False, soft_wrap=True)


def say(text: str = "") -> None:
    """Print one line at once, so that a pipe shows progress too.

    A terminal that was lost takes no line; what goes on must not end because of that.
    """
    try:
        console.print(text, markup=False)
        sys.stdout.flush()
    except OSError as error:
        logger.debug("not printed (%s): %s", error, text)


def complain(text: str) -> None:
    """Print an error, if there is still a terminal to print it on."""
    try:
        error_console.print(text, markup=False)
    except OSError as error:
        logger.debug("not printed (%s): %s", error, text)


def show_table(table: Table) -> None:
    """Print a table as wide as the terminal, with its title and how it went."""
    console.print(terminal_table(table, width=console.width))


def write_json(path: Path | None, content: Any) -> None:
    """Write what a command found to ``--json FILE``; nothing when no file was asked for."""
    if path is None:
        return
    from tacauchy_rig.core.store.codec import to_plain

    text = json.dumps(to_plain(content), indent=2, allow_nan=False)
    write_text(path, text + "\n", option="--json")


def write_text(path: Path, text: str, *, option: str = "--out") -> None:
    """Write a page, or whatever an option names the file of."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise _unwritable(path, error, option=option) from error


def writable_folder(path: Path) -> Path:
    """Make a folder for results before they are computed, and return it."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            return path
    except OSError as error:
        raise _unwritable(path, error, option="--out") from error


def _unwritable(path: Path, error: OSError, *, option: str) -> RecordError:
    text = f"{path}: cannot be written: {error.strerror}"
    return RecordError(text, remedy=f"give {option} another path")


# Its records of a compiled module have ``compiled_s``: see sim/device.py.
_SOURCE = "sim.device.compiled"


class _Told(logging.Handler):
    """Tells of the first module that was compiled, and adds all up."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.seconds = 0.0

    def emit(self, record: logging.LogRecord) -> None:
        if self.seconds == 0.0:
            complain("compiling kernels once for this computer; later presses find them")
        self.seconds += getattr(record, "compiled_s", 0.0)


@contextmanager
def compilation_told() -> Iterator[None]:
    """Say on standard error that kernels are compiled, and in the end how long all of them took."""
    source, told = logging.getLogger(_SOURCE), _Told()
    source.addHandler(told)
    source.setLevel(logging.INFO)
    source.propagate = False
    try:
        yield
    finally:
        source.removeHandler(told)
        source.setLevel(logging.NOTSET)
        source.propagate = True
        if told.seconds:
            complain(f"compiling kernels once: {told.seconds:.0f} s")


class Steps:
    """Shows the steps of a long command; a context.

    On a terminal they are a bar with the seconds left, elsewhere plain lines.
    """

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

    def __call__(self, what: str, done: int, total: int, left: str | None = None) -> None:
        """Say what was done, which of how many steps that was, and what is left if it is known."""
        spent_s = time.monotonic() - self._started
        if left is None:
            left = f"about {spent_s / done * (total - done):.0f} s left" if 0 < done < total else ""
        if error_console.is_terminal:
            self._bar.update(self._task, description=what, completed=done, total=total, left=left)
        else:
            complain(f"  {done}/{total} {what}{', ' * bool(left)}{left}")
