"""``python -m tests.studies libuipc``: the benchmark's scenes by libuipc and by us, on one GPU."""

import importlib.util
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from sim.studies.bench.scenes import (
    FRAME_COUNT,
    Manner,
    Reference,
    ScenePress,
    SceneRow,
    Scenes,
    all_scenes,
    read_press,
    read_references,
    scene_tables,
)
from sim.studies.bench.study import REFERENCE_FILE, SCENE_LIMIT_S
from sim.studies.bench.timed_press import press_scene
from tacauchy_rig.app.cli.output import JsonFile, complain, say, show_table, write_json, write_text
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.markdown_page import criteria_page, table_prose
from tacauchy_rig.core.parallel import IsolatedWorker, ProcessFailedError
from tacauchy_rig.core.tables import Cell, Table, table_of
from tacauchy_rig.core.versions import commit, machine, versions
from tests.studies.bench_scenes import select_scenes
from tests.studies.libuipc.world import AS_SHIPPED, STRICT, press_in_libuipc

_PACKAGE = "pyuipc"
_DEVICE = "cuda:0"
# Of our batches' numbers, those up to this one: it has a pad for each, and sets them up one by one.
_MOST = 60
# Its kernels are compiled in the first press of a machine: two minutes on an H100.
_COMPILE_S = 300.0
# A row takes seconds: what does not end by then is stuck.
_LONGEST_S = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerRow(SceneRow):
    """A scene pressed by libuipc, or why it was not."""

    engine: str  # its version, and how strictly it solves
    remark: str = ""  # what else is to be said of the press

    def as_json(self) -> dict[str, Any]:
        """Return plain values."""
        own = {"engine": self.engine, "remark": self.remark}
        return {**super(PeerRow, self).as_json(), **own}


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
    device: Annotated[str, typer.Option("--device")] = _DEVICE,
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
    scenes, counts = select_scenes(only or (), drawn=drawn), tuple(environments or (1, 60))
    known = read_references(against, {**all_scenes(), **scenes})
    ours, peers = list[list[SceneRow]](), list[list[PeerRow]]()
    try:
        theirs = press_in_peer(scenes, counts, known, limit_s=limit_s)
        for own in press_in_ours(scenes, counts, known, device=device, limit_s=limit_s):
            peers.append(next(theirs))
            ours.append(own)
    except KeyboardInterrupt:
        complain(f"interrupted: {len(ours)} of {len(scenes)} scenes are done and kept")
    groups = [list(rows) for rows in zip(*ours, strict=True)]
    others = [list(rows) for rows in zip(*peers[: len(ours)], strict=True)]
    tables = [peer_table(rows, groups) for rows in others]
    tables += [table for rows in groups for table in scene_tables(rows)]
    for table in tables:
        show_table(table)
    command = f"python -m tests.studies libuipc --device {device}"
    note = f"Commit {commit() or 'not known'}."
    write_text(out, criteria_page(tables, title="Beside libuipc", note=note, command=command))
    facts = {
        "groups": [[row.as_json() for row in rows] for rows in groups],
        "peers": [[row.as_json() for row in rows] for rows in others],
        "references": known,
    }
    write_json(json_file, {**facts, "machine": machine(), "versions": versions()})
    say(f"page {out}")


def refuse_without_libuipc(device: str) -> None:
    """End where libuipc cannot run: the device is no GPU, or it is not installed."""
    if device != _DEVICE:
        raise ConfigError(
            f"libuipc has one GPU to itself, not --device {device}",
            remedy=f"give --device {_DEVICE}",
        )
    if importlib.util.find_spec("uipc") is None:
        raise ConfigError("libuipc is not installed", remedy=f"pip install {_PACKAGE}")


def press_in_ours(
    scenes: Scenes,
    counts: Sequence[int],
    references: Mapping[str, Reference],
    *,
    device: str,
    limit_s: float,
) -> Iterator[list[SceneRow]]:
    """Press one scene after the other in every number, each scene in a process of its own."""
    for name, stated in scenes.items():
        rows = []
        with IsolatedWorker() as process:
            for count in counts:
                manner = Manner(environments=count, device=device)
                row = SceneRow(
                    scene=name, manner=manner, press=None, reference=references.get(name)
                )
                try:
                    found = process.call(partial(press_scene, stated, manner), limit_s=limit_s)
                    row = replace(row, press=read_press(found))
                except ProcessFailedError as error:
                    row = replace(row, failure=error.message)
                complain(f"  {name}, {manner.text}: {row.text}")
                rows.append(row)
        yield rows


def press_in_peer(
    scenes: Scenes,
    counts: Sequence[int],
    references: Mapping[str, Reference],
    *,
    limit_s: float,
    press: Callable[..., tuple[ScenePress, str]] = press_in_libuipc,
) -> Iterator[list[PeerRow]]:
    """Press one scene after the other in libuipc, in every number of environments; one strictly.

    A row has failed after the limit, a minute at most; the first has time to compile besides [s].
    """
    ways = [*((AS_SHIPPED, count) for count in counts if count <= _MOST), (STRICT, 1)]
    limit_s = min(limit_s, _LONGEST_S)
    allowed_s = limit_s + _COMPILE_S
    # Its kernels stay loaded from press to press.
    with IsolatedWorker() as process, TemporaryDirectory(prefix="libuipc-") as folder:
        for name, stated in scenes.items():
            rows = []
            for tolerance, count in ways:
                row = PeerRow(
                    scene=name,
                    manner=Manner(tolerance="", device=_DEVICE, environments=count),
                    press=None,
                    reference=references.get(name),
                    engine=f"libuipc {_version()}, {tolerance}",
                )
                work = partial(press, json.dumps(stated), count, tolerance, folder=folder)
                try:
                    found, remark = process.call(work, limit_s=allowed_s)
                    row = replace(row, press=found, remark=remark)
                except ProcessFailedError as error:
                    process.end()  # what an error leaves on the GPU is not for the next
                    row = replace(row, failure=error.message.splitlines()[0])
                allowed_s = limit_s
                complain(f"  {name}, {row.manner.text}, {row.engine}: {row.text}")
                rows.append(row)
            yield rows


def _version() -> str:
    try:
        return metadata.version(_PACKAGE)
    except metadata.PackageNotFoundError:
        return "of unknown version"


def peer_table(rows: Sequence[PeerRow], groups: Sequence[Sequence[SceneRow]]) -> Table:
    """Return libuipc's rows, each beside ours of as many environments."""
    ours = {(row.scene, row.manner.environments): row for own in groups for row in own}

    def our(row: SceneRow) -> SceneRow | None:
        return ours.get((row.scene, row.manner.environments))

    def error(row: SceneRow | None) -> Cell:
        off = None if row is None else row.error()
        return None if off is None else f"{1e2 * off:+.1f}"

    def speed(row: SceneRow | None) -> float | None:
        if row is None or row.press is None:
            return None
        return FRAME_COUNT * (row.manner.environments or 1) / row.press.wall_s

    def ratio(row: SceneRow) -> Cell:
        own, theirs = speed(our(row)), speed(row)
        return None if own is None or theirs is None else f"{own / theirs:.3g}"

    def shown(value: float | None) -> Cell:
        return None if value is None else round(value)

    def balance(row: SceneRow | None) -> Cell:
        return None if row is None or row.press is None else f"{row.press.balance:.0e}"

    prose = table_prose(
        "tests.studies.libuipc",
        "table.md.jinja",
        "peer",
        engine=rows[0].engine,
        environments=rows[0].manner.environments,
        remarks=[f"{row.scene}: {row.remark}" for row in rows if row.remark],
    )
    return table_of(
        rows,
        {
            "scene": lambda row: row.scene,
            "ours [1/s]": lambda row: shown(speed(our(row))),
            "libuipc [1/s]": lambda row: row.failure or shown(speed(row)),
            "ours over it": ratio,
            "F_z off by [%]": lambda row: error(our(row)),
            "its [%]": error,
            "balance": lambda row: balance(our(row)),
            "its balance": balance,
        },
        **prose,
    )
