"""Versions of everything that a result depends on."""

from __future__ import annotations

import os
import platform
from importlib import metadata

from tacauchy_rig import __version__

_DISTRIBUTIONS = (
    "warp-lang",
    "pytetwild",
    "numpy",
    "scipy",
    "pypardiso",
    "mkl",
    "opencv-contrib-python-headless",
    "scikit-image",
    "ur-rtde",
    "pyserial",
    "mcap",
)


def versions() -> dict[str, str]:
    """Return name and version of the program, its numerical libraries and device clients."""
    found = {
        "tacauchy-rig": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
    }
    for name in _DISTRIBUTIONS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "absent"
    return found


def machine() -> str:
    """Return where this runs, in words."""
    return f"{platform.system()}, {platform.machine()}, {os.cpu_count()} processors"
