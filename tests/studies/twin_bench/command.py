"""``python -m tests.studies twin-bench``: how a twin keeps up beside emulated runs."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from tacauchy_rig.app.cli.output import (
    JsonFile,
    complain,
    say,
    show_table,
    writable_folder,
    write_json,
    write_text,
)
from tacauchy_rig.app.twin.run_follower import Follows, twin_options
from tacauchy_rig.core.markdown_page import criteria_page
from tacauchy_rig.core.run import TrialRecord
from tacauchy_rig.core.study import selected
from tacauchy_rig.core.tables import Table, table_of_rows
from tacauchy_rig.core.versions import machine, versions
from tests.studies.page.command import emulated_session, reaction_table, twin_reactions

LAG_WANTED_MS = 200.0
_PAUSE_S = 1.0  # between two frames: longer ones lie between presses


Row = dict[str, Any]
"""What a run with a twin gave, by the table's headings; frames are those with contact."""


def keeps_up(row: Row, rate_wanted_hz: float) -> bool:
    """Return whether a twin is as quick as is wanted, and nothing was lost."""
    quick = row["frames/s"] >= rate_wanted_hz and row["lag, median [ms]"] < LAG_WANTED_MS
    return bool(quick and row["lost force"] == row["lost images"] == 0)


def press_with_twin(scene: TwinScene, folder: Path, *, device: str) -> Row:
    """Press a scene's trials on emulated devices, with a page and a twin."""
    viewers = [twin_options(Follows.FORCE, device=device)]
    store, result = emulated_session(folder, scene.overrides, viewers=viewers)
    busy = os.getloadavg()[0] / (os.cpu_count() or 1)
    lines = [json.loads(line) for line in store.paths.twin.read_text("utf-8").splitlines()]
    return row_of(scene.name, lines, result.records, busy=busy)


def row_of(
    name: str, lines: Sequence[dict[str, Any]], records: Sequence[TrialRecord], *, busy: float
) -> Row:
    """Return what a twin's lines and a run's results say."""
    pressed = [line for line in lines if line["force_n"] > 0.0]
    stamps = np.array([line["stamp_ns"] for line in pressed]) * 1e-9
    between = np.diff(stamps)
    between = between[between < _PAUSE_S]
    lags = [line["lag_ms"] for line in pressed]
    spent = [line["processor_ms"] for line in pressed]
    errors = [line["force_error_n"] / line["force_n"] for line in pressed if line["force_error_n"]]
    return {
        "scene": name,
        "frames": len(pressed),
        "frames/s": 1.0 / float(between.mean()) if len(between) else 0.0,
        "lag, median [ms]": _at(lags, 50),
        "lag, 95 % [ms]": _at(lags, 95),
        "processor time of a frame, median [ms]": _at(spent, 50),
        "of it, 95 % [ms]": _at(spent, 95),
        "failed": sum(bool(line["note"]) for line in lines),
        "error of F_z, at most": max(errors, default=float("nan")),
        "lost force": sum(round(each.rates["force_lost_count"]) for each in records),
        "lost images": sum(round(each.rates["image_lost_count"]) for each in records),
        "trials": ", ".join(each.outcome.value for each in records),
        # Processes that wanted a processor at the end, over the processors there are.
        "load": busy,
    }


def twin_table(rows: Sequence[Row], *, rate_wanted_hz: float) -> Table:
    """Return the rates as a table."""
    return table_of_rows(
        rows,
        title="A twin beside emulated runs, with a page",
        criterion=f"at least {rate_wanted_hz:g} frames/s, median lag below {LAG_WANTED_MS:g} ms, "
        "and not one sample of force or image lost",
        passed=all(keeps_up(row, rate_wanted_hz) for row in rows),
        note="Of frames with contact. Load: processes that wanted a processor when the run ended, "
        "the run's own included, over the processors there are; where that is far above 1, others "
        "worked on the machine, and a twin of the lowest priority has what they leave. Processor "
        "time is what a frame costs whoever else works there; an idle processor gives a frame in "
        "that, and at most 40 a second, as often as the force is shown.",
    )


def _at(values: Sequence[float], percent: float) -> float:
    return float(np.percentile(values, percent)) if len(values) else float("nan")


_BALL = ('indenter.kind="sphere"', 'indenter.diameter="8 mm"', 'indenter.fillet="0 mm"')
_SOFT = ('protocol.force_targets=["0.8 N", "2 N"]',)
_HARD = ('protocol.force_targets=["1.2556 N", "4.7332 N"]',)


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinScene:
    """A press by name, as changes of the default configuration."""

    name: str
    overrides: tuple[str, ...]


SCENES = (
    TwinScene(name="GelSight Mini, cylinder", overrides=_HARD),
    TwinScene(name="GelSight Mini, ball", overrides=(*_HARD, *_BALL)),
    TwinScene(
        name="GelSight Mini, cylinder, friction 0.5", overrides=(*_HARD, "replay.friction=0.5")
    ),
    TwinScene(
        name="GelSight Mini, cylinder, tilted by 1 deg",
        overrides=(*_HARD, 'replay.tilt=["1 deg", "0 deg"]'),
    ),
    TwinScene(name="DIGIT, ball", overrides=(*_SOFT, *_BALL, 'sensor.name="digit"')),
    TwinScene(name="9DTact, cylinder", overrides=(*_SOFT, 'sensor.name="9dtact"')),
)


GUARD_PAIRS = 20
RATES_WANTED_HZ = {"twin": 10.0, "twin_gpu": 30.0}
RUNS = Path("runs", "twin-bench").resolve()
_NOTE = (
    "Each row is a run of two presses on emulated devices with a page, and a twin that follows the "
    "force at the lowest priority. [Watch a twin](../../how-to/watch-a-twin.md) explains it."
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
    rows: list[Row] = []
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
        rows.append(press_with_twin(scene, RUNS / "presses", device=device))
        facts["rows"] = rows
        tables = [twin_table(rows, rate_wanted_hz=RATES_WANTED_HZ[name])]
        write()  # After every scene, so that Ctrl-C leaves what was found until then.
    if device == "cpu":  # Where images are drawn elsewhere, the guard has only less beside it.
        complain("  the guard with a twin and without")
        pairs = twin_reactions(RUNS / "guard", GUARD_PAIRS, complain)
        facts |= {"guard_with_ms": pairs.one_ms, "guard_without_ms": pairs.other_ms}
        tables.append(
            reaction_table(pairs, "with a twin and a watched page", "with the page alone")
        )
        write()
    for table in tables:
        show_table(table)
    for kind in ("json", "md"):
        say(str(out / f"{name}.{kind}"))
