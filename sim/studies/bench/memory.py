"""Peak memory of this process."""

from __future__ import annotations

import resource
import sys

_KIB, _MIB = 1024.0, 1024.0**2


def peak_memory_mib() -> float:
    """Return the largest resident set so far [MiB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1.0 if sys.platform == "darwin" else _KIB) / _MIB
