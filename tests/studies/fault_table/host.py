"""What goes wrong with the computer, made for the program under test alone.

A library that is preloaded into the program, ``host_trouble.c``, turns its wall clock and makes its
disk read-only, full or slow: none needs a right that only root has, and nothing else on the
computer notices.
"""

from __future__ import annotations

import os
import subprocess
from enum import StrEnum
from importlib import resources
from pathlib import Path

from tacauchy_rig.core.errors import DeviceError

_SOURCE = "host_trouble.c"


class Trouble(StrEnum):
    """What the library knows: names of the files that switch it on."""

    CLOCK_BACK = "clock-back"
    CLOCK_FORWARD = "clock-forward"
    READ_ONLY = "read-only"
    DISK_FULL = "disk-full"
    DISK_SLOW = "slow-disk"


class HostTrouble:
    """Trouble that can be switched on and off while the program runs.

    Args:
        folder: Where the library and its switches go.
        disk: Folder that becomes read-only, full or slow.
    """

    def __init__(self, folder: Path, *, disk: Path) -> None:
        folder.mkdir(exist_ok=True)
        self._folder, self._disk = folder, disk
        self._library = folder / "host_trouble.so"
        source = resources.files("tests.studies.fault_table").joinpath(_SOURCE).read_bytes()
        command = ["cc", "-O1", "-shared", "-fPIC", "-o", str(self._library), "-x", "c", "-"]
        try:
            subprocess.run(command, input=source, check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError) as error:
            said = getattr(error, "stderr", b"") or b""
            raise DeviceError(
                f"{_SOURCE} cannot be compiled: {error} {said.decode(errors='replace')}".strip(),
                remedy="install a C compiler that answers to `cc`, such as gcc",
            ) from error

    @property
    def environment(self) -> dict[str, str]:
        """Environment of a program that is to have the trouble."""
        return {
            **os.environ,
            "LD_PRELOAD": str(self._library),
            "HOST_TROUBLE": str(self._folder),
            "HOST_TROUBLE_DISK": str(self._disk),
        }

    def begin(self, trouble: Trouble) -> None:
        """Switch it on."""
        (self._folder / trouble.value).touch()

    def end(self) -> None:
        """Switch all of it off."""
        for trouble in Trouble:
            (self._folder / trouble.value).unlink(missing_ok=True)
