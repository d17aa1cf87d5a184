"""What a replay takes longest for, while its run is still recorded, by a process beside.

How the gel goes to the largest force depends on nothing that is measured but its modulus, and a
stiffer gel goes on from there (``sim/walk.py``); so it is with what a lean does to it
(``foreseen.py``). Optics know nothing of the presses. The process is the last to be served, and
works beside the replay too.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import partial

from sim.sensor.sensor import Sensor
from sim.walk import Walk
from tacauchy_rig.app.replay.foreseen import Foreseen, foresee
from tacauchy_rig.app.replay.inputs import ReplayInputs
from tacauchy_rig.app.replay.mounting import Dwell, FoundMounting, with_found_lean
from tacauchy_rig.app.replay.optics import Calibrate, OpticalCalibration, Say, optics_of
from tacauchy_rig.app.replay.parts import Part
from tacauchy_rig.app.replay.pressing import Pressed, press_parts, walk_ahead
from tacauchy_rig.app.replay.settings import sensor_of
from tacauchy_rig.core.config.model import RigConfig
from tacauchy_rig.core.errors import RigError
from tacauchy_rig.core.side_by_side import beside

_NICE = 19
# Of the process that went ahead: what it walked.
_walks: list[Walk] = []

Seen = tuple[OpticalCalibration, list[str]]
"""How images are rendered, and what was said of it."""


class Beside:
    """A process that works beside a replay.

    Args:
        other: It.
        optics: Tells there how images are rendered.
    """

    def __init__(self, other: Executor, optics: Callable[[], Seen]) -> None:
        self.other, self._optics = other, optics
        self._seen = other.submit(optics)

    def seen(self) -> Seen:
        """Return how images are rendered; what could not be told ahead is told now.

        Raises:
            ConfigError: As for ``optics_of``.
        """
        try:
            return self._seen.result()
        except RigError:
            return self.other.submit(self._optics).result()

    def find_lean(
        self, dwells: Sequence[Dwell], inputs: ReplayInputs, config: RigConfig
    ) -> FoundMounting:
        """Find a run's lean as ``with_found_lean`` does."""
        return with_found_lean(dwells, inputs, config)

    def pressing(self, parts: Sequence[Part], on_progress: Say) -> Callable[[], list[Pressed]]:
        """Press the parts of a run as ``press_parts`` does; here, while optics are told there.

        Returns:
            What gives the presses, when they are asked for.
        """
        pressed = press_parts(parts, on_progress=on_progress)
        return lambda: pressed


class Ahead(Beside):
    """One that has begun while the run was recorded."""

    def __init__(self, other: Executor, optics: Callable[[], Seen], config: RigConfig) -> None:
        self._foreseen = other.submit(_foresee, config)
        other.submit(_walk, config)
        super().__init__(other, optics)

    def foreseen(self) -> Foreseen | None:
        """Return what the replay asks of the configuration alone; None where that failed."""
        return self._foreseen.result()

    def find_lean(
        self, dwells: Sequence[Dwell], inputs: ReplayInputs, config: RigConfig
    ) -> FoundMounting:
        """Find it there, where coarse presses were made."""
        foreseen = self.foreseen()
        find = partial(with_found_lean, foreseen=None if foreseen is None else foreseen.restoring)
        return self.other.submit(find, dwells, inputs, config).result()

    def pressing(self, parts: Sequence[Part], on_progress: Say) -> Callable[[], list[Pressed]]:
        """Begin to press there, on from where it went; this process is free meanwhile."""
        begun = self.other.submit(_press, parts)

        def found() -> list[Pressed]:
            pressed, said = begun.result()
            for line in said:
                on_progress(line)
            return pressed

        return found


@contextmanager
def going_ahead(config: RigConfig, calibrate: Calibrate | None) -> Iterator[Ahead | None]:
    """Begin with a run's replay before it is recorded; with one processor, give nothing.

    Args:
        calibrate: As for ``replay_run``.

    Raises:
        ConfigError: The configured sensor does not exist.
    """
    if len(os.sched_getaffinity(0)) < 2:
        yield None
        return
    with beside() as other:
        yield Ahead(other, optics_told(config, sensor_of(config), calibrate), config)


def optics_told(
    config: RigConfig, sensor: Sensor, calibrate: Calibrate | None
) -> Callable[[], Seen]:
    """Return what tells how images of a sensor are rendered; it can be pickled."""
    return partial(_seen, config.sensor.optics_calibration, sensor, calibrate)


def _seen(given: str, sensor: Sensor, calibrate: Calibrate | None) -> Seen:
    said: list[str] = []
    return optics_of(given, sensor, calibrate=calibrate, on_progress=said.append), said


def _foresee(config: RigConfig) -> Foreseen | None:
    os.nice(_NICE)
    try:
        return foresee(config)
    except RigError:
        return None  # asked of again, it says so


def _walk(config: RigConfig) -> None:
    try:
        walk = walk_ahead(config)
    except RigError:
        return  # pressed again when it is asked for, it says so
    if walk is not None:
        _walks.append(walk)


def _press(parts: Sequence[Part]) -> tuple[list[Pressed], list[str]]:
    """Return what was pressed, and what was said meanwhile."""
    said: list[str] = []
    return press_parts(parts, on_progress=said.append, walks=_walks), said
