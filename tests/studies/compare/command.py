"""``python -m tests.studies compare COMMIT``: the benchmark's scenes by two commits, in turns."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from sim.studies.bench.part import SCENE_LIMIT_S
from sim.studies.bench.scenes.catalogue import BenchScene, select_scenes
from sim.studies.bench.scenes.own_process import Order, SceneRow, commit, git, pressed
from sim.studies.bench.scenes.suite import said
from sim.studies.bench.scenes.tables import way
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import complain, say, show_table, write_json, write_text
from tacauchy_rig.core.page import criteria_page, table_prose
from tacauchy_rig.core.tables import Table, table_of
from tacauchy_rig.core.versions import machine, versions

# Presses of each commit, in turns; the least time counts.
_TURNS = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """A scene by an old commit and by this checkout."""

    old: SceneRow
    new: SceneRow


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
    scenes = select_scenes(*only or ())
    alone = [Order(tolerance=each, device=device) for each in tolerances or ("5%",)]
    batches = [Order(environments=count, device=device) for count in environments or ()]
    tables, facts = [], []
    for order in (replace(each, limit_s=limit_s) for each in batches or alone):
        complain(f"scenes, {way(order)}")
        pairs = list(pressed_in_turns(scenes, order, name))
        tables.append(pairs_table(pairs, commit=name))
        facts.append([asdict(pair) for pair in pairs])
        show_table(tables[-1])
    command = f"python -m tests.studies compare {name}"
    title = f"Commit {commit()} beside {name}"
    write_text(out, criteria_page(tables, title=title, note="", command=command))
    write_json(json_file, {"pairs": facts, "machine": machine(), "versions": versions()})
    say(f"page {out}")


def pressed_in_turns(scenes: Sequence[BenchScene], order: Order, name: str) -> Iterator[Pair]:
    """Press every scene by another commit and by this checkout, in turns.

    Raises:
        ConfigError: There is no such commit.
    """
    with checked_out(name) as tree:
        for scene in scenes:
            turns = [
                (pressed(scene, replace(order, checkout=tree)), pressed(scene, order))
                for _ in range(_TURNS)
            ]
            pair = Pair(old=_least(old for old, _ in turns), new=_least(new for _, new in turns))
            complain(f"  {scene.name}: {said(pair.old)} before, {said(pair.new)} now")
            yield pair


def _least(rows: Iterator[SceneRow]) -> SceneRow:
    known = list(rows)
    return min((row for row in known if row.press), key=lambda row: row.spent_s, default=known[0])


def pairs_table(pairs: Sequence[Pair], *, commit: str) -> Table:
    """Return times and forces of both commits, one scene a row."""

    def ratio(pair: Pair) -> float | None:
        return pair.new.spent_s / pair.old.spent_s if pair.old.press and pair.new.press else None

    def apart(pair: Pair) -> str | None:
        if pair.old.press is None or pair.new.press is None:
            return None
        return f"{pair.new.press.force_n[2] / pair.old.press.force_n[2] - 1.0:.1e}"

    return table_of(
        pairs,
        {
            "scene": lambda pair: pair.new.scene,
            "before": lambda pair: pair.old.setting,
            "[s]": lambda pair: pair.old.spent_s if pair.old.press else None,
            "now": lambda pair: pair.new.setting,
            "now [s]": lambda pair: pair.new.spent_s if pair.new.press else None,
            "over before": ratio,
            "F_z apart": apart,
        },
        **table_prose("tests.studies.compare", "table.md.jinja", "pairs", commit=commit),
    )


@contextmanager
def checked_out(name: str) -> Iterator[Path]:
    """Check another commit out into a folder that is gone afterwards.

    Raises:
        ConfigError: There is no such commit, or this is no checkout of git.
    """
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git("worktree", "add", "--detach", str(tree), name)
        try:
            yield tree
        finally:
            git("worktree", "remove", "--force", str(tree))
