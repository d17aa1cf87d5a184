"""Emulated controllers for tests of the arm, each on a loopback address of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.emulators.launch import EmulatedProcess, free_loopback_host
from drivers.ur5_model import UrModel


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedUr:
    """A running emulated controller."""

    host: str
    folder: Path
    model: UrModel
    process: EmulatedProcess


EmulateUr = Callable[..., EmulatedUr]


@pytest.fixture
def emulate_ur(tmp_path: Path) -> Iterator[EmulateUr]:
    """Return a function that starts a controller; those it started end with the test."""
    started: list[EmulatedProcess] = []

    def start(model: UrModel = UrModel.E_SERIES, *more: str) -> EmulatedUr:
        host = free_loopback_host()
        arguments = ["drivers.emulators.ur_controller", "--host", host, "--model", model.value]
        process = EmulatedProcess(
            "robot", [*arguments, "--folder", str(tmp_path), *more], folder=tmp_path
        )
        started.append(process)
        process.wait_ready()
        return EmulatedUr(host=host, folder=tmp_path, model=model, process=process)

    yield start
    for process in started:
        process.stop()
        if process.process.stdout is not None:
            process.process.stdout.close()
