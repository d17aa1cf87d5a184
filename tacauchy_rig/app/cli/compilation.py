"""Says when kernels are compiled: once on a computer, and the reason why a first press is slow."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from tacauchy_rig.app.cli.output import complain

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
