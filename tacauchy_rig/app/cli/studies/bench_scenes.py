"""``tacauchy-rig bench --part scenes``: every kind of press timed, shown and written."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from sim.error.tolerance import parse_tolerance
from sim.studies.bench.part import REFERENCE_FILE
from sim.studies.bench.scenes.catalogue import BenchScene, all_scenes, select_scenes
from sim.studies.bench.scenes.figure import draw_scenes
from sim.studies.bench.scenes.own_process import Order, SceneRow, commit
from sim.studies.bench.scenes.references import (
    Reference,
    measure_references,
    read_references,
)
from sim.studies.bench.scenes.suite import SceneBench, press_all, said
from sim.studies.bench.scenes.tables import scene_tables, way
from tacauchy_rig.app.cli.output import complain, say, show_table, write_json, write_text
from tacauchy_rig.core.errors import ConfigError
from tacauchy_rig.core.page import criteria_page
from tacauchy_rig.core.store.codec import dumps
from tacauchy_rig.core.versions import machine, versions


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenesAsked:
    """The command's options, by their names; ``limit_s`` is ``--limit``."""

    only: tuple[str, ...]
    drawn: int | None
    tolerances: tuple[str, ...]
    device: str
    environments: tuple[int, ...]
    images: bool
    own_mesh: bool
    reference: bool
    against: Path | None
    limit_s: float

    @property
    def orders(self) -> list[Order]:
        """Every way to press: alone by each tolerance, or in each batch."""
        alone = [Order(tolerance=each, device=self.device) for each in self.tolerances]
        batches = [
            Order(
                environments=count,
                images=self.images,
                own_mesh=self.own_mesh,
                device=self.device,
            )
            for count in self.environments
        ]
        return [replace(each, limit_s=self.limit_s) for each in batches or alone]

    def command(self, out: Path) -> str:
        """Return the command that asks for this."""
        words = ["tacauchy-rig", "bench", "--part", "scenes"]
        words += [word for each in self.only for word in ("--only", each)]
        words += ["--drawn", str(self.drawn)] if self.drawn is not None else []
        for name, values in (("tolerance", self.tolerances), ("environments", self.environments)):
            words += [word for value in values for word in (f"--{name}", str(value))]
        words += ["--device", self.device] if self.device != Order().device else []
        words += ["--images"] if self.images else []
        words += ["--own-mesh"] if self.own_mesh else []
        words += ["--reference"] if self.reference else []
        words += ["--against", str(self.against)] if self.against else []
        return shlex.join([*words, "--out", str(out)])


def bench_scenes(asked: ScenesAsked, *, out: Path, json_file: Path | None) -> None:
    """Press the scenes; show tables, write page, figure and JSON.

    Raises:
        ConfigError: There is no such scene or tolerance, or options do not fit together.
        RecordError: A file cannot be written.
    """
    scenes = select_scenes(*asked.only, drawn=asked.drawn)
    for text in asked.tolerances:
        parse_tolerance(text, field="--tolerance")
    if (asked.images or asked.own_mesh) and not asked.environments:
        raise ConfigError(
            "--images and --own-mesh are for batches", remedy="give --environments too"
        )
    found = _measured(asked, scenes, out)
    tables = scene_tables(found)
    for table in tables:
        show_table(table)
    command = asked.command(out)
    facts = {
        **asdict(found),
        "command": command,
        "commit": commit(),
        "machine": machine(),
        "versions": versions(),
    }
    write_json(out / "scenes.json", facts)
    write_json(json_file, facts)
    drawn = draw_scenes(found, folder=out)
    page = criteria_page(
        tables,
        title="Benchmark: scenes",
        note=f"Commit {commit() or 'not known'}."
        + (" Interrupted: not all scenes were pressed." if found.interrupted else ""),
        image=next((file.name for file in drawn if file.suffix == ".png"), ""),
        command=command,
    )
    write_text(out / "scenes.md", page)
    for file in (*drawn, out / "scenes.json", out / "scenes.md"):
        say(str(file))


def _measured(asked: ScenesAsked, scenes: Sequence[BenchScene], out: Path) -> SceneBench:
    file = asked.against or out / REFERENCE_FILE
    references = read_references(file, (*all_scenes(), *scenes))
    if asked.reference:
        complain("references")
        command = asked.command(out)
        for name, each in measure_references(
            scenes, limit_s=asked.limit_s, command=command, on_progress=complain
        ):
            references[name] = each
            # One by one: what took so long is not lost to what comes after.
            write_text(file, dumps(references).decode())
    return _pressed(asked, scenes, references)


def _pressed(
    asked: ScenesAsked, scenes: Sequence[BenchScene], references: dict[str, Reference]
) -> SceneBench:
    """Press each scene in every way; an interruption keeps what is done."""

    def on_progress(row: SceneRow) -> None:
        complain(f"  {row.scene}, {way(row)}: {said(row)}")

    done = []
    try:
        for rows in press_all(scenes, asked.orders, on_progress=on_progress):
            done.append(rows)
    except KeyboardInterrupt:
        if not done:
            raise
        complain(f"interrupted: {len(done)} of {len(scenes)} scenes are done and kept")
    return SceneBench(
        groups=tuple(zip(*done, strict=True)),
        references=references,
        interrupted=len(done) < len(scenes),
    )
