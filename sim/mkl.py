"""Intel MKL's Pardiso: where its library is, and how many threads a factor of some size takes."""

from __future__ import annotations

import importlib
import os
from importlib import metadata
from pathlib import Path
from typing import Any

# Read by MKL too, in this order: who sets one has chosen for every system.
_CHOSEN_BY_USER = ("MKL_NUM_THREADS", "OMP_NUM_THREADS")
# Several threads cost a factor processor time while they wait for one another: a quarter to a half
# more below this many unknowns, a fifth above. More than four were not tried. Measured by
# `bench --part threads`: docs/decisions/0009-one-thread-for-small-systems.md.
_SEVERAL_FROM_UNKNOWNS, _THREADS_MAX = 50_000, 4
# Where pypardiso looks for the library first.
_LIBRARY = "PYPARDISO_MKL_RT"


def pardiso_module() -> Any:
    """Return pypardiso, told where MKL is: it would search every folder of the installation.

    Raises:
        ImportError: It, or MKL, is not installed.
    """
    if _LIBRARY not in os.environ and (library := _installed_library()):
        os.environ[_LIBRARY] = library
    return importlib.import_module("pypardiso")


def thread_count(unknowns: int) -> int:
    """Return how many threads a system of so many unknowns is factored with."""
    for name in _CHOSEN_BY_USER:
        text = os.environ.get(name, "")
        if text.isdigit() and int(text) > 0:
            return int(text)
    if unknowns < _SEVERAL_FROM_UNKNOWNS:
        return 1
    return min(_THREADS_MAX, len(os.sched_getaffinity(0)))


def take_threads(library: Any, unknowns: int) -> None:
    """Let MKL take as many threads as a system of so many unknowns deserves.

    To be called before every phase: Pardiso crashes where a factor meets another number of threads
    than its analysis had, and the number is that of the process.
    """
    library.MKL_Set_Num_Threads(thread_count(unknowns))


def _installed_library() -> str:
    """Return MKL's own library as its distribution lists it, or nothing."""
    try:
        files = metadata.files("mkl") or []
    except metadata.PackageNotFoundError:
        return ""
    found = (file.locate() for file in files if file.name.startswith("libmkl_rt"))
    return next((str(Path(str(each)).resolve()) for each in found), "")
