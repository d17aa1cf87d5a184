"""``python -m tests.studies libuipc``: the benchmark's scenes by libuipc and by us, on one GPU."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from sim.studies.bench.press import press_scene
from sim.studies.bench.scene_tables import scene_tables
from sim.studies.bench.scenes import (
    BenchScene,
    Manner,
    SceneRow,
    all_scenes,
    read_references,
    select_scenes,
)
from sim.studies.bench.study import REFERENCE_FILE, SCENE_LIMIT_S
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import complain, say, show_table, write_json, write_text
from tacauchy_rig.core.page import criteria_page
from tacauchy_rig.core.parallel import IsolatedWorker, ProcessFailedError
from tacauchy_rig.core.versions import commit, machine, versions
from tests.studies.libuipc.rows import (
    BESIDE_PEER,
    PeerRow,
    press_in_peer,
    refuse_without_libuipc,
)
from tests.studies.libuipc.table import peer_tables


def libuipc(
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="PATTERN", help="Scenes named so.")
    ] = None,
    drawn: Annotated[
        int | None, typer.Option("--drawn", metavar="SEED", help="A dozen scenes drawn at random.")
    ] = None,
    environments: Annotated[
        list[int] | None, typer.Option("--environments", metavar="N", min=1)
    ] = None,
    device: Annotated[str, typer.Option("--device")] = "cuda:0",
    against: Annotated[
        Path, typer.Option("--against", metavar="FILE", help="Reference forces.")
    ] = REFERENCE_FILE,
    limit_s: Annotated[
        float, typer.Option("--limit", metavar="SECONDS", help="In libuipc a minute at most.")
    ] = SCENE_LIMIT_S,
    out: Annotated[Path, typer.Option("--out", metavar="FILE")] = Path("libuipc.md"),
    json_file: JsonFile = None,
) -> None:
    """Press every scene by our batch and by libuipc, one after the other on the same GPU.

    Example: python -m tests.studies libuipc --only ball --environments 60
    """
    refuse_without_libuipc(device)
    scenes, counts = select_scenes(*only or (), drawn=drawn), tuple(environments or BESIDE_PEER)
    manners = [Manner(environments=count, device=device) for count in counts]
    done: list[tuple[tuple[SceneRow, ...], tuple[PeerRow, ...]]] = []
    try:
        ours = press_in_ours(scenes, manners, limit_s=limit_s)
        theirs = press_in_peer(scenes, counts, limit_s=limit_s, on_progress=_said)
        for both in zip(ours, theirs, strict=True):
            done.append(both)
    except KeyboardInterrupt:
        complain(f"interrupted: {len(done)} of {len(scenes)} scenes are done and kept")
    groups, peers = (tuple(zip(*rows, strict=True)) for rows in zip(*done, strict=True))
    references = read_references(against, (*all_scenes(), *scenes))
    tables = list(peer_tables(groups, references, peers))
    tables += [table for rows in groups for table in scene_tables(rows, references)]
    for table in tables:
        show_table(table)
    command = f"python -m tests.studies libuipc --device {device}"
    note = f"Commit {commit() or 'not known'}."
    write_text(out, criteria_page(tables, title="Beside libuipc", note=note, command=command))
    facts = {
        "groups": [[row.as_json() for row in rows] for rows in groups],
        "peers": [[asdict(row) for row in rows] for rows in peers],
    }
    write_json(json_file, {**facts, "machine": machine(), "versions": versions()})
    say(f"page {out}")


def press_in_ours(
    scenes: Sequence[BenchScene], manners: Sequence[Manner], *, limit_s: float
) -> Iterator[tuple[SceneRow, ...]]:
    """Press one scene after the other in every manner, each scene in a process of its own."""
    for scene in scenes:
        rows = []
        with IsolatedWorker() as process:
            for manner in manners:
                row = SceneRow(scene=scene.name, manner=manner, press=None)
                try:
                    press = process.call(
                        partial(press_scene, scene.stated, manner), limit_s=limit_s
                    )
                    row = replace(row, press=press)
                except ProcessFailedError as error:
                    row = replace(row, failure=error.message)
                _said(row)
                rows.append(row)
        yield tuple(rows)


def _said(row: SceneRow) -> None:
    engine = f", {row.engine}" if isinstance(row, PeerRow) else ""
    complain(f"  {row.scene}, {row.manner.text}{engine}: {row.text}")
