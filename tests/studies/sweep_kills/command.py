"""Study "sweep-kills": a sweep whose processes are killed, on three engines, beside one left alone.

A press is lost that the data set lacks in the end, and computed twice that two files hold or whose
finished file was written again.
"""

import hashlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from operator import itemgetter
from pathlib import Path
from tempfile import mkdtemp
from typing import Annotated, Any

import pyarrow.parquet as pq
import typer

from tacauchy_rig.app.cli.studies import StudyRun
from tacauchy_rig.core.study import Case, Result, Study, founds
from tacauchy_rig.core.tables import Table, table_of

_PLAN = """
design = "sobol"
count = {count}
seed = {seed}
[press]
sensor = "gelsight-mini"
indenter = ["sphere:diameter=6mm", "cylinder:diameter=5mm,fillet=0.5mm", "object:ring"]
x = {{ from = "-4 mm", to = "4 mm" }}
depth = {{ from = "0.3 mm", to = "0.8 mm" }}
noise = 1
[simulation]
edge = "4 mm"
samples = 1
shard = 4
"""
_PROGRAM = [sys.executable, "-m", "tacauchy_rig.app.cli.app"]
_MOMENTS = (0.1, 0.4, 0.8)  # of the files, at which a sweep is killed
_TASKS, _REJECTED, _WALLTIME_S, _GRACE_S = 3, 2, 8.0, 20.0


class SweepKills(Study):
    """Sweeps that are killed."""

    name, title, is_together = "sweep-kills", "Sweeps that are killed", True
    page_file = Path("docs/results/sweep_kills.md")

    def __init__(self, count: int, seed: int) -> None:
        self.folder, self.files = Path(mkdtemp(prefix="sweep-kills-")), -(-count // 4)
        self.count, self.plan = count, self.folder / "plan.toml"
        self.plan.write_text(_PLAN.format(count=count, seed=seed))

    def cases(self) -> Sequence[Case]:
        """Return the engines."""
        engines = {
            "processes killed at three moments": self._processes,
            "Dask: worker killed, worker stopped for 3 s, scheduler restarted": self._dask,
            "SLURM's stand-in: tasks ended at their walltime, one rejected": self._slurm,
        }
        return [Case(name=n, measure=partial(self._measured, of)) for n, of in engines.items()]

    def tables(self, results: Sequence[Result]) -> list[Table]:
        """Return what each engine lost."""
        rows = founds(results)
        columns: dict[str, Callable[[Any], Any]] = {
            name: itemgetter(name)
            for name in ("engine", "processes ended", "presses", "lost", "computed twice")
        }
        columns["files as undisturbed"] = lambda row: "yes" if row["identical"] else "no"
        columns["wall time [s]"] = lambda row: row["wall_s"]
        good = [r["identical"] and not r["lost"] and not r["computed twice"] for r in rows]
        return [
            table_of(
                rows,
                columns,
                title="Presses after the kills",
                criterion="no press lost or computed twice, all files identical byte by byte",
                passed=all(good) and len(good) == len(results),
            )
        ]

    @cached_property
    def _undisturbed(self) -> Mapping[str, str]:
        out = self.folder / "undisturbed"
        assert self._swept(out).wait() == 0
        return _sums(out)

    def _measured(self, disturbed: Callable[[Path, list[dict[str, int]]], int]) -> dict[str, Any]:
        """Return what a disturbed sweep gave; ``disturbed`` returns how many processes it ended."""
        expected, started = self._undisturbed, time.monotonic()
        out, seen = self.folder / disturbed.__name__, list[dict[str, int]]()
        ended = disturbed(out, seen)
        rows = [
            h for f in _shards(out) for h in pq.read_table(out / "shards" / f)["hash"].to_pylist()
        ]
        again = sum(
            _shards(out).get(file) != stamp for kept in seen for file, stamp in kept.items()
        )
        return {
            "engine": disturbed.__name__.strip("_"),
            "processes ended": ended,
            "presses": self.count,
            "lost": self.count - len(set(rows)),
            "computed twice": sum(Counter(rows).values()) - len(set(rows)) + 4 * again,
            "identical": _sums(out) == expected,
            "wall_s": round(time.monotonic() - started, 1),
        }

    def _swept(self, out: Path, *words: str) -> subprocess.Popen[bytes]:
        return _start([*_PROGRAM, "sweep", str(self.plan), "--out", str(out), *words], self.folder)

    def _until(self, out: Path, share: float, process: subprocess.Popen[bytes]) -> dict[str, int]:
        """Wait until so many files are there; return them with their times."""
        while len(found := _shards(out)) < share * self.files and process.poll() is None:
            time.sleep(0.02)
        return found

    def _processes(self, out: Path, seen: list[dict[str, int]]) -> int:
        for moment in _MOMENTS:
            running = self._swept(out, "--jobs", "2")
            seen.append(self._until(out, moment, running))
            _kill(running)
        assert self._swept(out, "--jobs", "2").wait() == 0
        return len(_MOMENTS)

    def _dask(self, out: Path, seen: list[dict[str, int]]) -> int:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
        address = f"tcp://127.0.0.1:{port}"

        def dask(*words: str) -> subprocess.Popen[bytes]:
            command = [sys.executable, "-m", f"distributed.cli.dask_{words[0]}", *words[1:]]
            return _start([*command, "--no-dashboard"], self.folder)

        def workers(count: int) -> list[subprocess.Popen[bytes]]:
            one = ("worker", address, "--nthreads", "1", "--no-nanny")
            return [dask(*one) for _ in range(count)]

        scheduler_words = ("scheduler", "--host", "127.0.0.1", "--port", port)
        running = [dask(*scheduler_words), *workers(3)]
        sweep = self._swept(out, "--engine", "dask", "--address", address)
        try:
            seen.append(self._until(out, 0.1, sweep))
            _kill(running[1])
            running[2].send_signal(signal.SIGSTOP)
            time.sleep(3.0)
            running[2].send_signal(signal.SIGCONT)
            seen.append(self._until(out, 0.5, sweep))
            for process in running:  # workers end with their scheduler
                _kill(process)
            running = [dask(*scheduler_words), *workers(2)]
            assert sweep.wait() == 0
        finally:
            for process in [*running, sweep]:
                _kill(process)
        return 5

    def _slurm(self, out: Path, seen: list[dict[str, int]]) -> int:
        assert self._swept(out, "--slurm", str(_TASKS)).wait() == 0
        script, requeued = out / "sweep.sbatch", self.folder / "requeued"
        scontrol = self.folder / "scontrol"
        scontrol.write_text(f'#!/bin/sh\necho "${{2##*_}}" >> {requeued}\n')
        scontrol.chmod(0o755)
        queue, ended = [task for task in range(_TASKS) if task != _REJECTED], 0
        while queue:
            requeued.write_text("")
            tasks = [
                _start(["bash", str(script)], self.folder, SLURM_ARRAY_TASK_ID=str(task))
                for task in queue
            ]
            ended += _end_at_walltime(tasks)
            seen.append(_shards(out))
            queue = [int(task) for task in requeued.read_text().split()]
        assert self._swept(out).wait() == 0  # the index, as the page says
        return ended


def _end_at_walltime(tasks: Sequence[subprocess.Popen[bytes]]) -> int:
    """Announce the end of tasks at their walltime, end what goes on; return how many were told."""
    _wait(tasks, _WALLTIME_S)
    told = [task for task in tasks if task.poll() is None]
    for task in told:
        task.send_signal(signal.SIGUSR1)
    _wait(told, _GRACE_S)
    for task in told:
        _kill(task)
    return len(told)


def _wait(tasks: Sequence[subprocess.Popen[bytes]], most_s: float) -> None:
    deadline = time.monotonic() + most_s
    while time.monotonic() < deadline and any(task.poll() is None for task in tasks):
        time.sleep(0.05)


def _start(command: Sequence[str], folder: Path, **further: str) -> subprocess.Popen[bytes]:
    """Start a process with its own group, so that what it starts can be killed with it."""
    path = f"{folder}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "SLURM_ARRAY_JOB_ID": "7", **further}
    with (folder / "log").open("ab") as log:
        return subprocess.Popen(
            command, env=environment, stdout=log, stderr=log, start_new_session=True
        )


def _kill(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _shards(out: Path) -> dict[str, int]:
    return {file.name: file.stat().st_mtime_ns for file in out.glob("shards/*.parquet")}


def _sums(out: Path) -> dict[str, str]:
    files = sorted(out.rglob("*.parquet"))
    return {str(f.relative_to(out)): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}


def sweep_kills(
    *,
    presses: Annotated[int, typer.Option("--presses", min=12, help="Of the plan.")] = 40,
    seed: Annotated[int, typer.Option("--seed", help="Of the plan.")] = 1,
    how: StudyRun,
) -> None:
    """Kill sweeps on three engines, and compare their files with those of one left alone.

    Example: python -m tests.studies sweep-kills
    """
    how.measure(SweepKills(presses, seed))
