"""Where shards are computed: in processes, on GPUs, by Dask's workers, or by tasks of a folder.

Every engine calls the same function with the same shards, so that files do not tell engines apart.
"""

import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread

from tacauchy_rig.app.sweep.shards import Made, Shard
from tacauchy_rig.core.errors import ConfigError, RigError
from tacauchy_rig.core.parallel import worker_process
from tacauchy_rig.core.versions import library

Work = Callable[[Shard, str], Made]
"""Returns a shard's file, computed on a device."""
Engine = Callable[[Work, Sequence[Shard]], Iterator[tuple[Shard, Made]]]
"""Computes shards, and yields each with its file as soon as it is there."""


def _computed(
    pools: Iterable[tuple[Executor, str]], work: Work, shards: Sequence[Shard]
) -> Iterator[tuple[Shard, Made]]:
    """Yield shards as they are done; every pool computes one at a time, on its device."""
    left = deque(shards)
    running: dict[Future[Made], tuple[Shard, Executor, str]] = {}

    def begin(pool: Executor, device: str) -> None:
        if left:
            shard = left.popleft()
            running[pool.submit(work, shard, device)] = shard, pool, device

    for pool, device in pools:
        begin(pool, device)
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            shard, pool, device = running.pop(future)
            begin(pool, device)
            yield shard, future.result()


@dataclass(frozen=True, slots=True)
class Processes:
    """One process for each of some devices, of which one may be named several times."""

    devices: Sequence[str]

    def __call__(self, work: Work, shards: Sequence[Shard]) -> Iterator[tuple[Shard, Made]]:
        """Compute on this machine; with one device in this process."""
        if len(self.devices) == 1 or len(shards) == 1:
            yield from ((shard, work(shard, self.devices[0])) for shard in shards)
            return
        with ExitStack() as opened:
            devices = self.devices[: len(shards)]
            pools = [(opened.enter_context(worker_process()), device) for device in devices]
            yield from _computed(pools, work, shards)


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
        lost = (OSError, TimeoutError, CancelledError, distributed.CancelledError)
        left, since = {shard.name: shard for shard in shards}, time.monotonic()
        while left:
            try:
                with distributed.Client(self.address, timeout=10) as client:
                    workers = [(client.get_executor(retries=_RETRIES), "cpu")] * _AHEAD
                    for shard, made in _computed(workers, work, list(left.values())):
                        since = time.monotonic()
                        yield left.pop(shard.name), made
            except lost as error:
                if time.monotonic() - since > _AWAY_S:
                    raise ConfigError(
                        f"--address {self.address}: no scheduler for {_AWAY_S:.0f} s: {error}",
                        remedy="start `dask scheduler`, and `dask worker ADDRESS` on each machine; "
                        "what is computed stays",
                    ) from error
                time.sleep(1.0)


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
