"""Mocks as the drivers of another package, so that the processes of a run find them."""

import fcntl
import os
import runpy
import subprocess
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any

import pytest

from protocols.processes import child_process
from tacauchy_rig.core.config import load
from tacauchy_rig.core.config.load import LoadedConfig
from tests.drivers.conftest import FORKED

_METADATA = Path(__file__).parent / "metadata"
_ROOT = Path(__file__).parents[2]
_MOCKS = [f'{device}.driver="mock"' for device in ("robot", "force_sensor", "camera")]


def _be_child(
    arguments: list[str], passed: dict[int, Connection], log: Connection, env: dict[str, str]
) -> None:
    os.setsid()
    os.environ.update(env)
    sys.path[:0] = env["PYTHONPATH"].split(os.pathsep)
    # Above all numbers that they are to have: one must not take another's before it has its own.
    held = {number: fcntl.fcntl(end.fileno(), fcntl.F_DUPFD, 500) for number, end in passed.items()}
    for number in (1, 2):
        os.dup2(log.fileno(), number)
    for end in (log, *passed.values()):
        end.close()
    for number, high in held.items():
        os.dup2(high, number)
        os.close(high)
    module, sys.argv[1:] = arguments[3], arguments[4:]
    runpy.run_module(module, run_name="__main__")


class ForkedChild:
    """Stands for the ``subprocess.Popen`` of a run's process; begins as a fork."""

    returncode: int | None = None

    def __init__(
        self,
        arguments: list[str],
        *,
        pass_fds: Collection[int],
        stdout: IO[bytes],
        env: Mapping[str, str],
        **_options: Any,
    ) -> None:
        passed = {number: Connection(os.dup(number)) for number in pass_fds}
        log = Connection(os.dup(stdout.fileno()))
        self._process = FORKED.Process(target=_be_child, args=(arguments, passed, log, dict(env)))
        self._process.start()
        for end in (log, *passed.values()):
            end.close()
        self.pid, self.kill = self._process.pid, self._process.kill

    def poll(self) -> int | None:
        """Return its exit status, or None while it runs."""
        self.returncode = self._process.exitcode
        return self.returncode

    def wait(self) -> None:
        """Wait for its end."""
        self._process.join()
        self.poll()


@contextmanager
def mocks_installed() -> Iterator[None]:
    """Let this process and its children, which are forks, find ``driver = "mock"``."""
    popen = SimpleNamespace(Popen=ForkedChild, DEVNULL=subprocess.DEVNULL)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child_process, "subprocess", popen)
        patch.syspath_prepend(_METADATA)
        known = os.environ.get("PYTHONPATH", "")
        patch.setenv("PYTHONPATH", os.pathsep.join([str(_METADATA), str(_ROOT), known]))
        yield


def load_mocks(*overrides: str) -> LoadedConfig:
    """Return the dry run with mocks; its values are given, as those of a real arm have to be."""
    file = Path(load.__file__).parent / "default.toml"
    return load.load_config(file, overrides=[*_MOCKS, *overrides])
