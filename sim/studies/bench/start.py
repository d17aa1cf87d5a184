"""How long the program takes until it works: its help, a first press, and compiling kernels."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from tempfile import TemporaryDirectory

from tacauchy_rig.core.errors import RigError

# What an operator does not notice, and what is little beside a press [s of the processor].
HELP_MAX_S, PRESS_MAX_S = 0.4, 1.5
_REPEATS = 3
_HELP = (("--version",), ("--help",), ("press", "--help"), ("study", "bench", "--help"))
# Says the processor and wall time of a second press: the first also pays for what both need.
_TWO_PRESSES = """
import time
from sim.press import press
from sim.press_command import scene_from
scene = scene_from(
    "--sensor gelsight-mini --indenter sphere:diameter=10mm --depth 0.05mm --preset fast"
)
press(scene)
cpu, wall = time.process_time(), time.perf_counter()
press(scene)
print(time.process_time() - cpu, time.perf_counter() - wall)
"""
# Warp's own: where compiled kernels are kept.
_CACHE = "WARP_CACHE_PATH"


@dataclass(frozen=True, slots=True, kw_only=True)
class StartRow:
    """What passes before work begins.

    Attributes:
        cpu_s: Processor time [s].
        wall_s: Time [s].
        limit_s: Of the processor time; None where nothing is demanded.
    """

    what: str
    cpu_s: float
    wall_s: float
    limit_s: float | None = None


def measure_start() -> list[StartRow]:
    """Measure the start of commands and of a press, the kernels compiled, then not.

    Raises:
        RigError: One of them fails.
    """
    rows = []
    for words in _HELP:
        cpu_s, wall_s = min(_spent(_program(words))[:2] for _ in range(_REPEATS))
        rows.append(StartRow(what=" ".join(words), cpu_s=cpu_s, wall_s=wall_s, limit_s=HELP_MAX_S))
    warm = min(_until_a_press() for _ in range(_REPEATS))
    rows.append(StartRow(what="until a press", cpu_s=warm[0], wall_s=warm[1], limit_s=PRESS_MAX_S))
    with TemporaryDirectory() as empty:
        cold = _until_a_press({_CACHE: empty})
    compiling = (cold[0] - warm[0], cold[1] - warm[1])
    return [*rows, StartRow(what="compiling kernels once", cpu_s=compiling[0], wall_s=compiling[1])]


def _program(words: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", "tacauchy_rig.app.cli.app", *words]


def _until_a_press(environment: dict[str, str] | None = None) -> tuple[float, float]:
    """Return processor and wall time of a process that presses twice, less twice the second."""
    cpu_s, wall_s, told = _spent([sys.executable, "-c", _TWO_PRESSES], environment)
    again_cpu_s, again_wall_s = (float(word) for word in told.split())
    return cpu_s - 2.0 * again_cpu_s, wall_s - 2.0 * again_wall_s


def _spent(
    command: Sequence[str], environment: dict[str, str] | None = None
) -> tuple[float, float, str]:
    """Return processor time and time of a process [s], and what it printed."""
    before, begun = _children_s(), time.perf_counter()
    done = subprocess.run(
        command,
        env=os.environ | (environment or {}),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RigError(
            f"{' '.join(command)} ended with {done.returncode}: {done.stderr.strip()}",
            remedy="run it by itself",
        )
    return _children_s() - before, time.perf_counter() - begun, done.stdout


def _children_s() -> float:
    """Return the processor time of all processes that this one has waited for [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
