"""What the command line prints: plain lines, progress on a terminal, JSON on request."""

from __future__ import annotations

import json
import logging
import sys
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console

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
    """Write what a command found to ``--json FILE``; nothing when no file was asked for.

    Raises:
        RecordError: The file cannot be written.
    """
    if path is None:
        return
    from tacauchy_rig.core.store.codec import to_plain

    text = json.dumps(to_plain(content), indent=2, allow_nan=False)
    write_text(path, text + "\n", option="--json")


def write_text(path: Path, text: str, *, option: str = "--out") -> None:
    """Write a page, or whatever an option names the file of.

    Raises:
        RecordError: The file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise _unwritable(path, error, option=option) from error


def writable_folder(path: Path) -> Path:
    """Make a folder for results before they are computed, and return it.

    Raises:
        RecordError: It cannot be made or written.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            return path
    except OSError as error:
        raise _unwritable(path, error, option="--out") from error


def _unwritable(path: Path, error: OSError, *, option: str) -> RecordError:
    text = f"{path}: cannot be written: {error.strerror}"
    return RecordError(text, remedy=f"give {option} another path")
