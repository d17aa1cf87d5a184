"""``python -m tests.studies twin-bench``: how a twin keeps up beside emulated runs."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from tacauchy_rig.app.cli.emulation import emulated_unit
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import (
    complain,
    say,
    show_table,
    writable_folder,
    write_json,
    write_text,
)
from tacauchy_rig.core.page import criteria_page
from tacauchy_rig.core.selection import selected
from tacauchy_rig.core.tables import Table
from tacauchy_rig.core.versions import machine, versions
from tests.studies.page.measures import twin_reaction_table, twin_reactions
from tests.studies.twin_bench.beside_runs import TwinRow, press_with_twin, twin_table
from tests.studies.twin_bench.scenes import SCENES

GUARD_PAIRS = 20
RATES_WANTED_HZ = {"twin": 10.0, "twin_gpu": 30.0}
RUNS = Path("runs", "twin-bench").resolve()
_NOTE = (
    "Each row is a run of two presses on emulated devices with a page, and a twin that follows the "
    "force at the lowest priority. [The twin](../../explanation/twin.md) is explained elsewhere."
)


def twin_bench(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Page and JSON.")] = Path(
        "twin-bench"
    ),
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="PATTERN", help="Scenes named so.")
    ] = None,
    device: Annotated[str, typer.Option("--device", help="Draws images: cpu or cuda:0.")] = "cpu",
    json_file: JsonFile = None,
) -> None:
    """Press every scene with a twin, and pair the guard's reaction with a twin and without.

    Example: python -m tests.studies twin-bench --only "DIGIT*"
    """
    only = only or []
    writable_folder(out)
    wanted = selected(SCENES, only, names=lambda scene: (scene.name,), kind="scene of the twin")
    rows: list[TwinRow] = []
    tables: list[Table] = []
    facts: dict[str, Any] = {"machine": machine(), "versions": versions()}
    name = "twin" if device == "cpu" else "twin_gpu"
    words = ["python -m tests.studies twin-bench"]
    words += [f'--only "{each}"' for each in only]
    words += [f"--device {device}"] if device != "cpu" else []
    command = " ".join([*words, f"--out {out}"])

    def write() -> None:
        for file in (out / f"{name}.json", json_file):
            write_json(file, facts)
        page = criteria_page(tables, title="How a twin keeps up", note=_NOTE, command=command)
        write_text(out / f"{name}.md", page)

    for scene in wanted:
        complain(f"  {scene.name}")
        rows.append(press_with_twin(scene, RUNS / "presses", unit_of=emulated_unit, device=device))
        facts["rows"] = [asdict(row) for row in rows]
        tables = [twin_table(rows, rate_wanted_hz=RATES_WANTED_HZ[name])]
        write()  # After every scene, so that Ctrl-C leaves what was found until then.
    if device == "cpu":  # Where images are drawn elsewhere, the guard has only less beside it.
        complain("  the guard with a twin and without")
        pairs = twin_reactions(RUNS / "guard", GUARD_PAIRS, complain)
        facts |= {"guard_with_ms": pairs.one_ms, "guard_without_ms": pairs.other_ms}
        tables.append(twin_reaction_table(pairs))
        write()
    for table in tables:
        show_table(table)
    for kind in ("json", "md"):
        say(str(out / f"{name}.{kind}"))
