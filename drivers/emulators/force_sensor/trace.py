"""The emulated force sensor's truth on disk: ``force_trace.jsonl``, one frame a line.

A run that is resumed starts the emulator anew, and its report needs the truth of the trials before
the interruption too. So the file is continued as long as the monotonic clock is the same; stamps of
another boot mean nothing beside new ones, and the file is begun anew.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TextIO

TRACE_FILE = "force_trace.jsonl"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def open_trace(path: Path, *, boot_id: str | None = None) -> TextIO:
    """Open the trace for more lines; the first line names the boot that its stamps belong to.

    Args:
        path: The file; it need not exist.
        boot_id: This boot; as the kernel names it if None.
    """
    first = json.dumps({"boot_id": boot_id or BOOT_ID.read_text("ascii").strip()}) + "\n"
    if not _begins_with(path, first):
        path.write_text(first, encoding="utf-8")
    trace = path.open("a", encoding="utf-8")
    if not _ends_a_line(path):
        trace.write("\n")  # a kill has torn the last line
    return trace


def _begins_with(path: Path, line: str) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.readline() == line.encode()


def _ends_a_line(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"
