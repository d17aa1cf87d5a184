"""``python -m tests.studies libuipc``: the benchmark's scenes by libuipc and by us, on one GPU."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from sim.studies.bench.part import REFERENCE_FILE, SCENE_LIMIT_S
from sim.studies.bench.scenes.catalogue import all_scenes, select_scenes
from sim.studies.bench.scenes.own_process import Order, SceneRow, commit
from sim.studies.bench.scenes.references import read_references
from sim.studies.bench.scenes.suite import SceneBench, press_all, said
from sim.studies.bench.scenes.tables import scene_tables, way
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import complain, say, show_table, write_json, write_text
from tacauchy_rig.core.page import criteria_page
from tacauchy_rig.core.versions import machine, versions
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
    ] = Path("docs/benchmarks", REFERENCE_FILE),
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
    orders = [Order(environments=count, device=device, limit_s=limit_s) for count in counts]
    done: list[tuple[tuple[SceneRow, ...], tuple[PeerRow, ...]]] = []
    try:
        ours = press_all(scenes, orders, on_progress=_said)
        theirs = press_in_peer(scenes, counts, limit_s=limit_s, on_progress=_said)
        for both in zip(ours, theirs, strict=True):
            done.append(both)
    except KeyboardInterrupt:
        complain(f"interrupted: {len(done)} of {len(scenes)} scenes are done and kept")
    groups, peers = (tuple(zip(*rows, strict=True)) for rows in zip(*done, strict=True))
    found = SceneBench(groups=groups, references=read_references(against, (*all_scenes(), *scenes)))
    tables = [*peer_tables(found, peers), *scene_tables(found)]
    for table in tables:
        show_table(table)
    command = f"python -m tests.studies libuipc --device {device}"
    note = f"Commit {commit() or 'not known'}."
    write_text(out, criteria_page(tables, title="Beside libuipc", note=note, command=command))
    facts = {**asdict(found), "peers": [[asdict(row) for row in rows] for rows in peers]}
    write_json(json_file, {**facts, "machine": machine(), "versions": versions()})
    say(f"page {out}")


def _said(row: SceneRow) -> None:
    engine = f", {row.engine}" if isinstance(row, PeerRow) else ""
    complain(f"  {row.scene}, {way(row)}{engine}: {said(row)}")
