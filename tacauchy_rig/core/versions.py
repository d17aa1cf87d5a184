"""Versions of everything that a result depends on, and the machine that it was made on."""

import os
import platform
import subprocess
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from tacauchy_rig import __version__
from tacauchy_rig.core.errors import ConfigError

ABSENT = "absent"
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


def installed(*distributions: str) -> dict[str, str]:
    """Return the version of Python and of each distribution, ``absent`` where there is none."""
    found = {"python": platform.python_version()}
    for name in distributions:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = ABSENT
    return found


def versions() -> dict[str, str]:
    """Return name and version of the program, its numerical libraries and device clients."""
    libraries = installed(*_DISTRIBUTIONS)
    return {
        "tacauchy-rig": __version__,
        "python": libraries.pop("python"),
        "platform": platform.platform(),
        **libraries,
    }


def library(name: str, *, extra: str) -> Any:
    """Import a library that an extra of this package installs. ConfigError: It is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        raise ConfigError(
            f"{name.partition('.')[0]}, which this needs, is not installed",
            remedy=f'pip install "tacauchy-rig[{extra}]"',
        ) from error


def machine() -> str:
    """Return where this runs, in words."""
    return f"{platform.system()}, {platform.machine()}, {os.cpu_count()} processors"


def commit() -> str:
    """Return the commit of the program's checkout, ``-dirty`` where files differ; empty outside."""
    words = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(
            [*words, "--abbrev=10", "--exclude=*"], capture_output=True, text=True, check=False
        )
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
