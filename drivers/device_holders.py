"""Which other programs hold a device's file open."""

import glob
import os
from contextlib import suppress
from pathlib import Path


def device_holders(path: str) -> list[str]:
    """Return "name (pid n)" of the other processes that hold ``path`` open.

    Only processes whose descriptors this user may read are seen.
    """
    target, numbers = os.path.realpath(path), set()
    for link in glob.iglob("/proc/[0-9]*/fd/*"):  # noqa: PTH207 - a process may end meanwhile
        with suppress(OSError):
            if os.readlink(link) == target:  # noqa: PTH115
                numbers.add(link.split("/")[2])
    holders = []
    for number in numbers - {str(os.getpid())}:
        name = "a process"
        with suppress(OSError):
            name = Path(f"/proc/{number}/comm").read_text("utf-8").strip()
        holders.append(f"{name} (pid {number})")
    return sorted(holders)
