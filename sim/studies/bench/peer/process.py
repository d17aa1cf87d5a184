"""Run libuipc in a process of its own: where it aborts, the benchmark goes on without it."""

from __future__ import annotations

import multiprocessing
import tempfile
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Self

from sim.studies.bench.peer.libuipc import press_in_libuipc
from sim.studies.bench.peer.task import PeerFound, PeerTask
from tacauchy_rig.errors import RigError

_GRACE_S = 5.0


class PeerFailedError(RigError):
    """libuipc gave no result."""


class PeerProcess:
    """A process in which libuipc presses; its kernels stay loaded from task to task.

    One that has aborted, or was ended because it took too long, is followed by another.

    Args:
        backend: libuipc's.
    """

    def __init__(self, *, backend: str = "cuda") -> None:
        self._backend = backend
        self._tasks: Connection | None = None
        self._process: SpawnProcess | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def press(self, task: PeerTask, *, limit_s: float) -> PeerFound:
        """Press.

        Raises:
            PeerFailedError: libuipc raised, aborted, or took longer.
        """
        tasks, process = self._running()
        try:
            tasks.send(task)
            if not tasks.poll(limit_s):
                self._end()
                raise PeerFailedError(f"libuipc was not done after {limit_s:g} s")
            found: PeerFound | str = tasks.recv()
        except (EOFError, OSError) as error:
            process.join(_GRACE_S)
            self._end()
            raise PeerFailedError(
                f"libuipc's process ended with status {process.exitcode} and no result"
            ) from error
        if isinstance(found, str):
            raise PeerFailedError(found)
        return found

    def _running(self) -> tuple[Connection, SpawnProcess]:
        if self._tasks is None or self._process is None:
            context = multiprocessing.get_context("spawn")
            self._tasks, theirs = context.Pipe()
            self._process = context.Process(
                target=_serve, args=(theirs, self._backend), daemon=True
            )
            self._process.start()
            theirs.close()
        return self._tasks, self._process

    def _end(self) -> None:
        if self._tasks is not None and self._process is not None:
            self._tasks.close()
            self._process.kill()
            self._process.join()
        self._tasks = self._process = None


def _serve(tasks: Connection, backend: str) -> None:
    with tempfile.TemporaryDirectory(prefix="libuipc-") as folder:
        while True:
            try:
                task: PeerTask = tasks.recv()
            except EOFError:
                return
            found: PeerFound | str
            try:
                found = press_in_libuipc(task, folder=folder, backend=backend)
            except Exception as error:  # noqa: BLE001 - this process's top: the row names the error
                found = f"{type(error).__name__}: {str(error).splitlines()[0]}"
            tasks.send(found)
