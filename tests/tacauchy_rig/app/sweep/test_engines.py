"""Engines give the same shards; tasks of a folder share them, survive others and their own end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tacauchy_rig.app.sweep.engines import Dask, Folder, InterruptedSweepError, Processes
from tacauchy_rig.app.sweep.files import Shard
from tacauchy_rig.app.sweep.plan import Simulation

SHARDS = [Shard(name=f"{k:032x}", rows=(), hashes=(), simulation=Simulation()) for k in range(6)]
EXPECTED = {shard.name: shard.name.encode() for shard in SHARDS}


def work(shard: Shard, device: str) -> bytes:
    """Stand in for ``make_shard``."""
    del device
    return shard.name.encode()


def slow_work(shard: Shard, device: str) -> bytes:
    """Take half a second."""
    time.sleep(0.5)
    return work(shard, device)


def _folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path / "claims", lambda name: (tmp_path / name).exists())


def _write(tmp_path: Path, made: Iterator[tuple[Shard, bytes]]) -> int:
    count = 0
    for shard, content in made:
        (tmp_path / shard.name).write_bytes(content)
        count += 1
    return count


@pytest.mark.parametrize("devices", [["cpu"], ["cpu", "cpu"]])
def test_processes_compute_every_shard_once(devices: list[str]) -> None:
    """Processes compute every shard once."""
    made = list(Processes(devices)(work, SHARDS))
    assert len(made) == len(SHARDS)
    assert {shard.name: content for shard, content in made} == EXPECTED


def test_tasks_of_a_folder_leave_what_others_claimed_or_finished(tmp_path: Path) -> None:
    """Tasks of a folder leave what others claimed or finished."""
    first, second = _folder(tmp_path)(work, SHARDS), _folder(tmp_path)
    one, content = next(first)
    assert _write(tmp_path, second(work, SHARDS)) == len(SHARDS) - 1
    (tmp_path / one.name).write_bytes(content)
    assert _write(tmp_path, first) == 0
    assert not list((tmp_path / "claims").iterdir())


def test_a_claim_of_a_dead_task_is_taken_over(tmp_path: Path) -> None:
    """A claim of a dead task is taken over."""
    claim = tmp_path / "claims" / SHARDS[0].name
    claim.parent.mkdir()
    claim.touch()
    assert _write(tmp_path, _folder(tmp_path)(work, SHARDS)) == len(SHARDS) - 1
    old = time.time() - 100.0
    claim.touch()
    os.utime(claim, (old, old))
    assert _write(tmp_path, _folder(tmp_path)(work, SHARDS)) == 1


def test_a_task_finishes_its_shard_when_its_end_is_announced(tmp_path: Path) -> None:
    """A task finishes its shard when its end is announced."""
    made = _folder(tmp_path)(work, SHARDS)
    shard, content = next(made)
    (tmp_path / shard.name).write_bytes(content)
    os.kill(os.getpid(), signal.SIGUSR1)
    with pytest.raises(InterruptedSweepError):
        next(made)
    assert _write(tmp_path, _folder(tmp_path)(work, SHARDS)) == len(SHARDS) - 1


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_dask_survives_the_death_of_a_worker(tmp_path: Path) -> None:
    """Dask survives the death of a worker."""
    pytest.importorskip("distributed")
    environment = os.environ | {"PYTHONPATH": f"{Path(__file__).parent}:{Path.cwd()}"}

    def start(*words: str) -> subprocess.Popen[bytes]:
        with (tmp_path / "log").open("ab") as log:
            command = [sys.executable, "-m", "distributed.cli." + words[0], *words[1:]]
            return subprocess.Popen(command, env=environment, stdout=log, stderr=log)

    file = tmp_path / "scheduler.json"
    running = [
        start("dask_scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    ]
    try:
        while not file.exists():
            time.sleep(0.1)
        address = json.loads(file.read_text())["address"]
        running += [
            start("dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
            for _ in range(2)
        ]
        made = {}
        for shard, content in Dask(address)(slow_work, SHARDS):
            made[shard.name] = content
            if len(made) == 1:
                running[1].kill()
        assert made == EXPECTED
    finally:
        for process in running:
            process.kill()
            process.wait()
