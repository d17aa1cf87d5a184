"""Who else holds a device file open."""

from __future__ import annotations

import os
from pathlib import Path


def device_holders(path: str, *, proc: Path = Path("/proc")) -> list[str]:
    """Return "name (pid n)" of the other processes that hold ``path`` open.

    Only processes whose descriptors this user may read are seen.
    """
    target = os.path.realpath(path)
    holders = []
    for process in proc.glob("[0-9]*"):
        if process.name == str(os.getpid()) or not _holds(process, target):
            continue
        try:
            name = (process / "comm").read_text("utf-8").strip()
        except OSError:
            name = "a process"
        holders.append(f"{name} (pid {process.name})")
    return sorted(holders)


def _holds(process: Path, target: str) -> bool:
    try:
        links = list((process / "fd").iterdir())
    except OSError:
        return False
    for link in links:
        try:
            if str(link.readlink()) == target:
                return True
        except OSError:
            continue
    return False
