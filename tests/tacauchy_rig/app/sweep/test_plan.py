"""Plans and what they refuse; engines give the same shards and survive each other's end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from tacauchy_rig.app.sweep.engines import Dask, Folder, InterruptedSweepError, Processes
from tacauchy_rig.app.sweep.files import Shard
from tacauchy_rig.app.sweep.plan import Row, Simulation, read_plan, row_hash, rows_of
from tacauchy_rig.core.errors import ConfigError

_HEAD = 'design = "{design}"\n{count}\n[press]\nsensor = "gelsight-mini"\n'
_BALL = 'indenter = "sphere:diameter=6mm"\n'


def _rows(
    folder: Path, press: str, *, design: str = "sobol", count: str = "count = 8"
) -> list[Row]:
    file = folder / "plan.toml"
    file.write_text(_HEAD.format(design=design, count=count) + press)
    return list(rows_of(read_plan(file)))


def test_grids_combine_and_lists_go_side_by_side(tmp_path: Path) -> None:
    """Grids combine and lists go side by side."""
    press = _BALL + 'depth = ["0.3 mm", "0.6 mm"]\nx = ["-1 mm", "2 mm"]\n'
    grid = _rows(tmp_path, press, design="grid", count="")
    side = _rows(tmp_path, press, design="list", count="")
    assert [(row.x_m, row.depth_m) for row in grid] == [
        (x, depth) for x in (-1e-3, 2e-3) for depth in (0.3e-3, 0.6e-3)
    ]
    assert [(row.x_m, row.depth_m) for row in side] == [(-1e-3, 0.3e-3), (2e-3, 0.6e-3)]


@pytest.mark.parametrize("design", ["sobol", "latin-hypercube"])
def test_drawn_values_fill_their_range_evenly(tmp_path: Path, design: str) -> None:
    """Drawn values fill their range evenly."""
    press = (
        _BALL + 'depth = { from = "0.2 mm", to = "1 mm" }\nx = { from = "-4 mm", to = "4 mm" }\n'
    )
    rows = _rows(tmp_path, press, design=design)
    for values, low, high in (
        ([row.depth_m for row in rows], 0.2e-3, 1e-3),
        ([row.x_m for row in rows], -4e-3, 4e-3),
    ):
        eighths = np.floor((np.array(values, float) - low) / (high - low) * 8)
        assert sorted(eighths) == list(range(8))


def test_a_longer_sobol_plan_begins_with_the_presses_of_a_shorter_one(tmp_path: Path) -> None:
    """A longer sobol plan begins with the presses of a shorter one."""
    press = _BALL + 'depth = { from = "0.2 mm", to = "1 mm" }\nmaterial = "stated"\n'
    short = _rows(tmp_path, press, count="count = 5")
    long = _rows(tmp_path, press, count="count = 9")
    assert long[:5] == short
    assert np.std([row.material for row in long]) > 0.03  # the file states 11 %


def test_a_hash_follows_inputs_and_settings_but_not_the_size_of_shards(tmp_path: Path) -> None:
    """A hash follows inputs and settings but not the size of shards."""
    (row,) = _rows(tmp_path, _BALL + 'depth = "0.5 mm"\n', count="count = 1")
    plan = read_plan(tmp_path / "plan.toml").simulation
    name = row_hash(row, plan)
    assert row_hash(row, plan.model_copy(update={"shard": 7})) == name
    assert row_hash(row, plan.model_copy(update={"edge": 2e-3})) != name


@pytest.mark.parametrize(
    ("press", "count", "design", "message"),
    [
        ('depth = "0.5 mm"\nx = "14 mm"\n', "count = 1", "sobol", "beside the gel"),
        ('depth = "0.5 mm"\ndept = "1 mm"\n', "count = 1", "sobol", "dept: unknown key"),
        ('depth = "0.5 mm"\n', "count = 1000000000", "sobol", "count"),
        ('depth = "0.5 mm"\n', "count = 1\nseed = -1", "sobol", "seed"),
        ('depth = "4.1 mm"\n', "count = 1", "sobol", "in a gel of 4 mm"),
        ('depth = "0.5 mm"\nforce = "1 N"\n', "count = 1", "sobol", "a depth or a force"),
        ('depth = "0.5 mm"\n[dataset]\nname = "../up"\n', "count = 1", "sobol", "dataset.name"),
        ('depth = { from = "0.1 mm", to = "1 mm" }\n', "", "grid", "no steps"),
        ('depth = "0.5 mm"\nfriction = 3\n', "count = 1", "sobol", "friction = 3"),
        ('depth = "0.5"\n', "count = 1", "sobol", "has no unit"),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, press: str, count: str, design: str, message: str
) -> None:
    """What cannot be is refused."""
    with pytest.raises(ConfigError, match=message) as refused:
        _rows(tmp_path, _BALL + press, design=design, count=count)
    assert refused.value.remedy


def test_a_grid_of_a_billion_presses_is_refused_before_it_is_made(tmp_path: Path) -> None:
    """A grid of a billion presses is refused before it is made."""
    steps = "".join(
        f'{name} = {{ from = "0.1 mm", to = "0.9 mm", steps = 1000 }}\n'
        for name in ("depth", "x", "y")
    )
    with pytest.raises(ConfigError, match="1,000,000,000 presses"):
        _rows(tmp_path, _BALL + steps, design="grid", count="")


def test_the_example_is_a_plan(tmp_path: Path) -> None:
    """The example is a plan."""
    text = resources.files("tacauchy_rig.app.sweep").joinpath("example.toml").read_text()
    (tmp_path / "plan.toml").write_text(text)
    rows = rows_of(read_plan(tmp_path / "plan.toml"))
    assert len(rows) == 500
    assert {row.object.partition(":")[0] for row in rows} == {"sphere", "cylinder"}


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
