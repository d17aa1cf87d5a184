"""Commands for other people's data: ``import``, and ``judge`` of other simulators' outputs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tacauchy_rig.app.cli.output import Found, Overrides, complain, say, writable_folder
from tacauchy_rig.core.errors import ConfigError, command_line
from tacauchy_rig.core.time_limit_and_progress import doing, heard

if TYPE_CHECKING:
    from reports.evidence.evidence_types import RunEvidence
    from reports.evidence.frames_and_curves import RunReading
    from tacauchy_rig.core.simulated import Outputs


@doing("importing")
def import_(
    source: Path, *, out: Path = Path("runs"), init: bool = False, overrides: Overrides = None
) -> Found | None:
    """Make a run folder from other recordings; what they do not state stays unknown.

    Example: tacauchy-rig import presses --init, then tacauchy-rig import presses --out runs

    Args:
        source (SOURCE): A folder with import.toml, that file, or the taxim wheel.
        out (DIR): Folder for the new run.
        init: Only write the folder's import.toml with guesses.
    """
    if init:
        from tacauchy_rig.app.importing.guess_import_toml import write_guess

        written, guesses = write_guess(source)
        say(f"wrote {written}")
        for question in guesses.asked:
            say(f"  check {question}")
        say(f"next: {command_line('import', source)}")
        return None
    from tacauchy_rig.app.importing.importer import import_run

    store = import_run(source, parent=out, overrides=overrides or ())
    imported = store.imported.load()
    if imported is not None:
        say(f"imported {len(imported.trials)} presses from {imported.source} ({imported.kind})")
        for sentence in (*imported.unknown, *imported.notes):
            complain(f"  {sentence}")
    say(f"run folder {store.paths.root}")
    say(f"next: {command_line('calibrate', 'optics', store.paths.root)} for images of balls, or")
    say(f"      {command_line('replay', store.paths.root)}")
    return Found({"run": str(store.paths.root), "imported": imported})


class Baseline(StrEnum):
    """Simulators that the program itself provides to judge others by."""

    RIGID = "rigid"


@doing("judging")
def judge(
    folders: list[Path] | None = None,
    *,
    run: Path,
    out: Path,
    ours_folder: Annotated[Path | None, typer.Option("--ours")] = None,
    baselines: Annotated[list[Baseline] | None, typer.Option("--baseline")] = None,
    is_task: Annotated[bool, typer.Option("--task")] = False,
) -> Found | None:
    """Score other simulators beside ours, with the floors and the ceiling of a report.

    Example: tacauchy-rig judge theirs --run runs/20261123-dry-run --out judged

    Args:
        folders ([FOLDER...]): Outputs of a simulator, as docs/reference/file-formats.md describes
            them.
        run (RUN): Folder of the run or import whose presses are scored.
        out (DIR): Folder of the page.
        ours_folder (FOLDER): Outputs of `calibrate optics --outputs`, in place of the run's replay.
        baselines: Score this too, and write its outputs to DIR/NAME. rigid: the indenter's shape
            cut into the gel at the measured depth, without mechanics; may be repeated.
        is_task: Only write what a simulator needs to know about the presses.
    """
    from reports.comparison.simulator_comparison import judge as judged
    from reports.page.simulator_comparison_page import write_judgement
    from tacauchy_rig.app.judging.task_and_baseline import replay_outputs, write_task
    from tacauchy_rig.app.replay.open_run import open_run
    from tacauchy_rig.app.replay.report_run import evidence_of

    if not (folders or baselines or is_task):
        raise ConfigError(
            "there is nothing to judge",
            remedy="name a FOLDER, or ask for --baseline rigid or --task",
        )
    reading = open_run(run)
    evidence = evidence_of(reading)
    if is_task:
        write_task(writable_folder(out), reading, evidence)
        say(f"wrote the task of {len(evidence.trials)} presses to {out}")
        return None
    written = [_write_baseline(each, reading, out) for each in dict.fromkeys(baselines or ())]
    others = read_folders([*(folders or ()), *written], evidence)
    if ours_folder is None:
        ours = replay_outputs(reading, evidence)
    else:
        (ours,) = read_folders([ours_folder], evidence)
    writable_folder(out)
    if ours is None:
        complain(f"{run} has no replay: `{command_line('replay', run)}`, or give --ours")
    judgement = judged(evidence, others, ours=ours)
    for each in judgement.simulators:
        residual, (won, of) = each.means["contact_relative_residual"].mean, each.wins
        if residual is not None:
            say(
                f"  {each.simulator.title}: contact residual {residual:.3f}, correct press wins "
                f"{won} of {of}"
            )
    paths = write_judgement(judgement, out)
    say(f"page {paths.html.resolve()}")
    return Found(json.loads(paths.json.read_text("utf-8")))


def _write_baseline(baseline: Baseline, reading: RunReading, out: Path) -> Path:
    """Write what a baseline shows of a run's presses to a new folder, and return that."""
    from tacauchy_rig.app.cli.emulated_calibration import emulated_calibration
    from tacauchy_rig.app.judging.task_and_baseline import check_empty, rigid_outputs, write_outputs

    folder = out / baseline.value
    check_empty(folder)
    calibrate = emulated_calibration(reading.store)
    with heard(say):
        found = rigid_outputs(reading, calibrate=calibrate)
    write_outputs(folder, found)
    say(f"wrote {len(found.presses)} presses to {folder}")
    return folder


def read_folders(folders: Sequence[Path], evidence: RunEvidence) -> list[Outputs]:
    """Return what simulators give of a run's presses."""
    from tacauchy_rig.app.judging.simulator_folder import Asked, read_outputs
    from tacauchy_rig.app.judging.task_and_baseline import references_of

    geometry = evidence.geometry
    asked = Asked(
        trials=tuple(t.index for t in evidence.trials),
        size_px=(geometry.width_px, geometry.height_px),
        references=references_of(evidence),
        measured={
            t.index: (t.record.force_measured_n, t.record.depth_measured_m)
            for t in evidence.trials
            if t.record is not None
        },
        pixel_m2=(geometry.scale_x_m_px or 0.0) * (geometry.scale_y_m_px or 0.0),
    )
    others = []
    for folder in folders:
        others.append(read_outputs(folder, asked))
        say(f"{others[-1].simulator.title}: {len(others[-1].presses)} presses of {folder}")
    titles = [each.simulator.title for each in others]
    if twice := sorted({title for title in titles if titles.count(title) > 1}):
        raise ConfigError(
            f"two folders are both of {', '.join(twice)}",
            remedy="tell them apart by name or version in their simulator.toml",
        )
    return others
