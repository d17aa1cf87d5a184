"""A sweep of a few presses: whole, repeated, interrupted, changed; read as a user would."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from unittest.mock import patch

import mlcroissant
import numpy as np
import pyarrow.parquet as pq
import pytest
from rocrate.rocrate import ROCrate

from tacauchy_rig.app.sweep import run
from tacauchy_rig.app.sweep.engines import Processes, Work
from tacauchy_rig.app.sweep.files import Shard
from tacauchy_rig.app.sweep.plan import Plan, read_plan, rows_of
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.rgb import decode_rgb

_PLAN = """
design = "sobol"
count = 5
[press]
sensor = "gelsight-mini"
indenter = ["sphere:diameter=6mm", "cylinder:diameter=5mm,fillet=0.5mm"]
x = { from = "-4 mm", to = "4 mm" }
depth = { from = "0.3 mm", to = "0.8 mm" }
[simulation]
edge = "5 mm"
samples = 1
shard = 2
"""


class KilledError(Exception):
    """Stands for the end of a process."""


class Counting:
    """An engine that counts presses, and ends after some shards."""

    def __init__(self, ends_after: int = 99) -> None:
        self.ends_after, self.pressed = ends_after, 0

    def __call__(self, work: Work, shards: Sequence[Shard]) -> Iterator[tuple[Shard, bytes]]:
        """Press in this process."""
        for number, shard in enumerate(shards):
            if number == self.ends_after:
                raise KilledError
            self.pressed += len(shard.rows)
            yield from Processes(["cpu"])(work, [shard])


def _plan(folder: Path, text: str = _PLAN) -> Plan:
    (folder / "plan.toml").write_text(text)
    return read_plan(folder / "plan.toml")


def _swept(plan: Plan, out: Path, *, ends_after: int = 99) -> int:
    engine = Counting(ends_after)
    assert run.sweep(plan, rows_of(plan), out, engine)
    return engine.pressed


def _bytes(out: Path) -> dict[str, bytes]:
    return {str(file.relative_to(out)): file.read_bytes() for file in out.rglob("*.parquet")}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Path]:
    """Return a plan and the folder of its data set."""
    folder = tmp_path_factory.mktemp("swept")
    plan = _plan(folder)
    assert _swept(plan, folder / "out") == 5
    return plan, folder / "out"


def test_a_sweep_again_computes_nothing_and_a_longer_one_what_is_new(
    swept: tuple[Plan, Path], tmp_path: Path
) -> None:
    """A sweep again computes nothing and a longer one what is new."""
    plan, out = swept
    before = _bytes(out)
    assert _swept(plan, out) == 0
    assert _bytes(out) == before
    longer = _plan(tmp_path, _PLAN.replace("count = 5", "count = 6"))
    with patch.object(run, "make_shard", side_effect=KilledError), pytest.raises(KilledError):
        _swept(longer, out)
    assert {name for name in _bytes(out) if name in before} == set(before)


def test_an_interrupted_sweep_loses_nothing_and_has_the_same_bytes(
    swept: tuple[Plan, Path], tmp_path: Path
) -> None:
    """An interrupted sweep loses nothing and has the same bytes."""
    plan, whole = swept
    with pytest.raises(KilledError):
        _swept(plan, tmp_path, ends_after=1)
    assert _swept(plan, tmp_path) == 3
    assert _bytes(tmp_path) == _bytes(whole)


def test_an_index_leads_to_images_fields_and_the_frame_without_contact(
    swept: tuple[Plan, Path],
) -> None:
    """An index leads to images fields and the frame without contact."""
    plan, out = swept
    index = pq.read_table(out / "index.parquet").to_pylist()
    assert [row["commanded_depth_m"] for row in index] == [row.depth_m for row in rows_of(plan)]
    for row in index:
        shard = pq.read_table(out / row["shard"])
        found = shard.slice(row["offset"], 1).to_pylist()[0]
        assert found["hash"] == row["hash"]
        assert row["valid"]
        assert row["force_z_n"] > 0.1
        assert abs(row["depth_m"] - row["commanded_depth_m"]) < 2e-6
        image, reference = decode_rgb(found["image"]), decode_rgb(found["reference"])
        assert image is not None
        assert reference is not None
        assert image.shape == reference.shape == (240, 320, 3)
        assert np.ptp(image) > 50
        assert np.ptp(reference) == 0
        shape = json.loads(shard.schema.field("pressure_pa").metadata[b"shape"])
        cell_m2 = (8 * 0.0634e-3) ** 2
        carried = np.reshape(found["pressure_pa"], shape).sum() * cell_m2
        # The mesh's own force, without its correction, and cells that cut the contact's edge.
        assert 0.8 < carried / row["force_z_n"] < 1.6
        deepest = float(np.nanmax(np.array(found["indentation_mm"], float)))
        assert abs(deepest * 1e-3 - row["depth_m"]) < 0.05e-3


def test_splits_share_no_object_and_no_place(swept: tuple[Plan, Path]) -> None:
    """Splits share no object and no place."""
    index = pq.read_table(swept[1] / "index.parquet").to_pylist()
    for split, group in (
        ("split_object", lambda row: row["object"]),
        ("split_place", lambda row: (row["x_m"] // 2e-3, row["y_m"] // 2e-3)),
    ):
        sides = {name: {group(r) for r in index if r[split] == name} for name in ("train", "test")}
        assert sides["train"]
        assert sides["test"]
        assert not sides["train"] & sides["test"]


@pytest.mark.filterwarnings("ignore")
def test_the_datasheet_is_read_by_other_programs(swept: tuple[Plan, Path]) -> None:
    """The datasheet is read by other programs."""
    out = swept[1]
    records = list(mlcroissant.Dataset(jsonld=out / "croissant.json").records("presses"))
    assert len(records) == 5
    assert ROCrate(out).name == "presses"
    assert "presses" in (out / "summary.html").read_text()


def test_a_damaged_shard_is_named(swept: tuple[Plan, Path], tmp_path: Path) -> None:
    """A damaged shard is named."""
    (tmp_path / "shards").mkdir()
    (tmp_path / "shards" / "bad.parquet").write_bytes(b"PAR1 nothing")
    with pytest.raises(RecordError, match=r"bad\.parquet"):
        _swept(swept[0], tmp_path)


def test_a_full_disk_stops_before_the_first_press(swept: tuple[Plan, Path], tmp_path: Path) -> None:
    """A full disk stops before the first press."""
    engine = Counting()
    full = patch.object(run, "free_bytes", return_value=1000)
    with full, pytest.raises(RecordError, match="0 MB free"):
        run.sweep(swept[0], rows_of(swept[0]), tmp_path, engine)
    assert engine.pressed == 0


class StandIn:
    """Stands for ``sbatch``: runs a script's tasks, ends them at their time, rejects one."""

    def __init__(self, folder: Path, script: Path) -> None:
        self.script, self.queue = script, folder / "requeued"
        (folder / "bin").mkdir()
        scontrol = folder / "bin" / "scontrol"
        scontrol.write_text(f'#!/bin/sh\necho "$2" >> {self.queue}\n')
        scontrol.chmod(0o755)
        path = f"{folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}"
        self.environment = os.environ | {"PATH": path, "SLURM_ARRAY_JOB_ID": "7"}

    def start(self, task: int) -> subprocess.Popen[bytes]:
        """Start a task that was not rejected."""
        environment = self.environment | {"SLURM_ARRAY_TASK_ID": str(task)}
        return subprocess.Popen(["bash", str(self.script)], env=environment)


@pytest.mark.slow
def test_tasks_of_a_cluster_end_at_their_time_and_are_requeued(
    swept: tuple[Plan, Path], tmp_path: Path
) -> None:
    """The first ends after a shard, the second never begins; the first does the rest later."""
    out, plan_file = tmp_path / "out", swept[1].parent / "plan.toml"
    command = [sys.executable, "-m", "tacauchy_rig.app.cli.app", "sweep", str(plan_file)]
    subprocess.run([*command, "--out", str(out), "--slurm", "2"], check=True)
    cluster = StandIn(tmp_path, out / "sweep.sbatch")
    assert "--array=0-1%2" in cluster.script.read_text()
    first = cluster.start(0)
    while not list(out.glob("shards/*.parquet")) and first.poll() is None:
        time.sleep(0.05)
    first.send_signal(signal.SIGUSR1)
    assert first.wait(60) == 75
    made = {file.name: file.stat().st_mtime_ns for file in (out / "shards").iterdir()}
    assert cluster.queue.read_text() == "7_0\n"
    assert cluster.start(0).wait(60) == 0
    assert {name: (out / "shards" / name).stat().st_mtime_ns for name in made} == made
    assert _bytes(out) == _bytes(swept[1])
