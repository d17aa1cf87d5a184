"""``python -m tests.studies compare COMMIT``: the benchmark's scenes by two commits, in turns."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from sim.studies.bench.scenes import Manner, SceneRow, Scenes, read_press
from sim.studies.bench.study import SCENE_LIMIT_S
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import complain, say, show_table, write_json, write_text
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.page import criteria_page, table_prose
from tacauchy_rig.core.tables import Table, table_of
from tacauchy_rig.core.versions import commit, machine, versions
from tests.studies.bench_scenes import select_scenes

# Presses of each commit, in turns; the least time counts.
_TURNS = 2
# What the libraries that solve and assemble take as their number of threads.
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
ROOT = Path(__file__).parents[3]
# Where a commit has the program that presses a scene, the newest first.
WORKERS = ("tests/studies/compare/worker.py", "sim/studies/bench/scenes/press.py")


Pair = tuple[SceneRow, SceneRow]
"""A scene by an old commit and by this checkout."""


def compare(
    name: Annotated[str, typer.Argument(metavar="COMMIT", help="Whose solver is compared.")],
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="PATTERN", help="Scenes named so.")
    ] = None,
    tolerances: Annotated[
        list[str] | None, typer.Option("--tolerance", metavar="5%|1%", help="May be repeated.")
    ] = None,
    device: Annotated[str, typer.Option("--device", help="cpu or cuda:0.")] = "cpu",
    environments: Annotated[
        list[int] | None, typer.Option("--environments", metavar="N", min=1, help="Batches.")
    ] = None,
    limit_s: Annotated[float, typer.Option("--limit", metavar="SECONDS")] = SCENE_LIMIT_S,
    out: Annotated[Path, typer.Option("--out", metavar="FILE")] = Path("compare.md"),
    json_file: JsonFile = None,
) -> None:
    """Press the scenes by another commit's solver and by this checkout's, in turns.

    Example: python -m tests.studies compare HEAD~5 --only ball
    """
    scenes = select_scenes(only or ())
    alone = [Manner(tolerance=each, device=device) for each in tolerances or ("5%",)]
    batches = [Manner(environments=count, device=device) for count in environments or ()]
    tables, facts = [], []
    for manner in batches or alone:
        complain(f"scenes, {manner.text}")
        pairs = list(pressed_in_turns(scenes, manner, name, limit_s=limit_s))
        tables.append(pairs_table(pairs, commit=name))
        facts.append([[row.as_json() for row in pair] for pair in pairs])
        show_table(tables[-1])
    command = f"python -m tests.studies compare {name}"
    title = f"Commit {commit()} beside {name}"
    write_text(out, criteria_page(tables, title=title, note="", command=command))
    write_json(json_file, {"pairs": facts, "machine": machine(), "versions": versions()})
    say(f"page {out}")


def pressed_in_turns(
    scenes: Scenes, manner: Manner, name: str, *, limit_s: float
) -> Iterator[Pair]:
    """Press every scene by another commit and by this checkout, in turns."""
    with checked_out(name) as tree:
        for scene, stated in scenes.items():
            turns = [
                [
                    pressed(scene, stated, manner, checkout=at, limit_s=limit_s)
                    for at in (tree, ROOT)
                ]
                for _ in range(_TURNS)
            ]
            old, new = (_least(rows) for rows in zip(*turns, strict=True))
            complain(f"  {scene}: {old.text} before, {new.text} now")
            yield old, new


def pressed(
    scene: str, stated: Mapping[str, Any], manner: Manner, *, checkout: Path, limit_s: float
) -> SceneRow:
    """Press a scene by a checkout's solver; an error, a crash and too long a time are rows."""
    worker = next(checkout / place for place in WORKERS if (checkout / place).exists())
    # Packages may lie elsewhere, but ours come from the checkout.
    places = [str(checkout), *filter(None, [os.environ.get("PYTHONPATH")])]
    counts = [] if manner.environments is None else [manner.environments]
    order = {
        **asdict(manner),
        "stated": stated,
        "preset": None,
        "counts": counts,
        "is_timed": True,
        "limit_s": limit_s,
    }
    try:
        done = subprocess.run(
            # -P: modules beside the file are no packages of their own.
            [sys.executable, "-P", str(worker)],
            input=json.dumps(order),
            env=os.environ | dict.fromkeys(_THREADS, "1") | {"PYTHONPATH": os.pathsep.join(places)},
            capture_output=True,
            text=True,
            check=False,
            timeout=limit_s,
        )
    except subprocess.TimeoutExpired:
        found: dict[str, Any] = {"failure": f"not done after {limit_s:g} s"}
    else:
        last = (done.stderr.strip().splitlines() or ["nothing"])[-1]
        answers = [line for line in done.stdout.splitlines() if line.startswith('{"')]
        ended = {"failure": f"its process ended with status {done.returncode}: {last}"}
        found = json.loads(answers[0]) if answers else ended
    failure = str(found.get("failure", ""))
    press = None if failure else read_press(found)
    return SceneRow(scene=scene, manner=manner, press=press, failure=failure)


def _least(rows: Sequence[SceneRow]) -> SceneRow:
    return max((r for r in rows if r.press), key=lambda r: r.frames_per_s, default=rows[0])


def pairs_table(pairs: Sequence[Pair], *, commit: str) -> Table:
    """Return times and forces of both commits, one scene a row."""

    def time_s(row: SceneRow) -> float | None:
        if row.press is None:
            return None
        return row.press.cpu_s if row.manner.device == "cpu" else row.press.wall_s

    def ratio(pair: Pair) -> float | None:
        old, new = map(time_s, pair)
        return None if old is None or new is None else new / old

    def apart(pair: Pair) -> str | None:
        old, new = (row.press for row in pair)
        return (
            None if old is None or new is None else f"{new.force_n[2] / old.force_n[2] - 1.0:.1e}"
        )

    return table_of(
        pairs,
        {
            "scene": lambda pair: pair[1].scene,
            "before": lambda pair: pair[0].setting,
            "[s]": lambda pair: time_s(pair[0]),
            "now": lambda pair: pair[1].setting,
            "now [s]": lambda pair: time_s(pair[1]),
            "over before": ratio,
            "F_z apart": apart,
        },
        **table_prose("tests.studies.compare", "table.md.jinja", "pairs", commit=commit),
    )


@contextmanager
def checked_out(name: str) -> Iterator[Path]:
    """Check another commit out into a folder that is gone afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git("worktree", "add", "--detach", str(tree), name)
        try:
            yield tree
        finally:
            git("worktree", "remove", "--force", str(tree))


def git(*words: str) -> str:
    """Return what git says of this checkout."""
    done = subprocess.run(
        ["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise ConfigError(
            f"git {words[0]}: {done.stderr.strip() or done.returncode}",
            remedy="name a commit of the program's own checkout",
        )
    return done.stdout.strip()
