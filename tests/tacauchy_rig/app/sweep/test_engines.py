"""Engines give the same shards; tasks of a folder share them, survive others and their own end."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tacauchy_rig.app.sweep.engines import Folder, InterruptedSweepError, Processes
from tacauchy_rig.app.sweep.plan import Simulation
from tacauchy_rig.app.sweep.shard import Shard

SHARDS = [Shard(name=f"{k:032x}", rows=(), hashes=(), simulation=Simulation()) for k in range(6)]
EXPECTED = {shard.name: shard.name.encode() for shard in SHARDS}


def work(shard: Shard, device: str) -> bytes:
    """Stand in for ``make_shard``."""
    del device
    return shard.name.encode()


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
