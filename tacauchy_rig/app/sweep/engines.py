"""Where shards are computed: in processes, on GPUs, by Dask's workers, or by tasks of a folder.

Every engine calls the same function with the same shards, so that files do not tell engines apart.
"""

import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from typing import Any

from tacauchy_rig.app.sweep.shards import Made, Shard
from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.versions import library

Work = Callable[[Shard, str], Made]
"""Returns a shard's file, computed on a device."""
Engine = Callable[[Work, Sequence[Shard]], Iterator[tuple[Shard, Made]]]
"""Computes shards, and yields each with its file as soon as it is there."""


@dataclass(frozen=True, slots=True)
class Processes:
    """One process for each of some devices, of which one may be named several times."""

    devices: Sequence[str]

    def __call__(self, work: Work, shards: Sequence[Shard]) -> Iterator[tuple[Shard, Made]]:
        """Compute on this machine; with one device in this process."""
        if len(self.devices) == 1 or len(shards) == 1:
            yield from ((shard, work(shard, self.devices[0])) for shard in shards)
            return
        left = deque(shards)
        running: dict[Future[Made], tuple[Shard, ProcessPoolExecutor, str]] = {}
        with ExitStack() as open_pools:

            def begin(pool: ProcessPoolExecutor, device: str) -> None:
                if left:
                    shard = left.popleft()
                    running[pool.submit(work, shard, device)] = shard, pool, device

            for device in self.devices[: len(shards)]:
                begin(open_pools.enter_context(worker_process()), device)
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    shard, pool, device = running.pop(future)
                    begin(pool, device)
                    yield shard, future.result()


# How often a shard is tried again whose worker died, how long Dask's scheduler may be away [s], and
# how many shards wait in it: their results must fit this machine's memory.
_RETRIES, _AWAY_S, _AHEAD = 5, 300.0, 64


@dataclass(frozen=True, slots=True)
class Dask:
    """Workers of ``dask.distributed``, whose scheduler is at an address such as ``tcp://host:8786``.

    A worker that dies is replaced by others; a scheduler that restarts is given again what is left.
    """

    address: str

    def __call__(self, work: Work, shards: Sequence[Shard]) -> Iterator[tuple[Shard, Made]]:
        """Compute on the workers.

        Raises:
            ConfigError: Dask is not installed, or no scheduler answers for five minutes.
        """
        distributed = library("distributed", extra="sweep")
        lost = (OSError, TimeoutError, distributed.CancelledError)
        left, since = {shard.name: shard for shard in shards}, time.monotonic()
        while left:
            try:
                with distributed.Client(self.address, timeout=10) as client:
                    for name, made in _gathered(distributed, client, work, list(left.values())):
                        since = time.monotonic()
                        yield left.pop(name), made
            except lost as error:
                if time.monotonic() - since > _AWAY_S:
                    raise ConfigError(
                        f"--address {self.address}: no scheduler for {_AWAY_S:.0f} s: {error}",
                        remedy="start `dask scheduler`, and `dask worker ADDRESS` on each machine; "
                        "what is computed stays",
                    ) from error
                time.sleep(1.0)


def _gathered(
    distributed: Any, client: Any, work: Work, shards: list[Shard]
) -> Iterator[tuple[str, Made]]:
    """Yield names and files; fails where the scheduler is gone."""
    waiting = deque(shards)

    def submitted() -> Any:
        shard = waiting.popleft()
        return client.submit(work, shard, "cpu", key=shard.name, retries=_RETRIES)

    first = [submitted() for _ in range(min(_AHEAD, len(waiting)))]
    for future in (running := distributed.as_completed(first)):
        if future.status == "cancelled" or client.status != "running":
            raise distributed.CancelledError(future.key)
        yield future.key, future.result()
        future.release()
        if waiting:
            running.add(submitted())


_HEARTBEAT_S, _STALE_S = 5.0, 60.0


@dataclass(frozen=True, slots=True)
class Folder:
    """A task among others that share a folder: it claims shards that no other one computes.

    A claim whose task has shown no life for a minute is taken over. After SIGTERM or SIGUSR1, with
    which a cluster announces the end, the shard at hand is finished and no other begun.
    """

    claims: Path  # folder of the claims
    is_done: Callable[[str], bool]  # whether a shard's file is there, by its name
    device: str = "cpu"

    def __call__(self, work: Work, shards: Sequence[Shard]) -> Iterator[tuple[Shard, Made]]:
        """Compute what can be claimed.

        Raises:
            InterruptedSweepError: The end was announced, and shards are left.
        """
        self.claims.mkdir(parents=True, exist_ok=True)
        with _end_announced() as ends:
            for shard in shards:
                if ends.is_set():
                    raise InterruptedSweepError("the end of this task was announced")
                if self.is_done(shard.name) or not self._claimed(shard.name):
                    continue
                with self._alive(shard.name):
                    if not self.is_done(shard.name):
                        yield shard, work(shard, self.device)

    def _claimed(self, name: str) -> bool:
        """Return whether this task has a shard now."""
        claim = self.claims / name
        with suppress(FileNotFoundError):
            if time.time() - claim.stat().st_mtime > _STALE_S:
                stale = claim.with_name(f"{name}.{os.getpid()}.{time.time_ns()}.stale")
                claim.rename(stale)  # by one task only: others find none
                stale.unlink()
        try:
            os.close(os.open(claim, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return False
        return True

    @contextmanager
    def _alive(self, name: str) -> Iterator[None]:
        """Show that the task lives, while it computes and its file is written."""
        claim, over = self.claims / name, Event()

        def beat() -> None:
            while not over.wait(_HEARTBEAT_S):
                with suppress(OSError):
                    os.utime(claim)

        beating = Thread(target=beat, daemon=True)
        beating.start()
        try:
            yield
        finally:
            over.set()
            beating.join()
            claim.unlink(missing_ok=True)


class InterruptedSweepError(RigError):
    """A task of a folder ended before all shards were there."""

    exit_code = 75  # EX_TEMPFAIL: sbatch.sh has the task requeued


@contextmanager
def _end_announced() -> Iterator[Event]:
    announced = Event()
    kept = {
        number: signal.signal(number, lambda *_: announced.set())
        for number in (signal.SIGTERM, signal.SIGUSR1)
    }
    try:
        yield announced
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
