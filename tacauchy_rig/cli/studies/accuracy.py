"""``tacauchy-rig accuracy``: what accuracy costs in time, for one press."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from reports.scores.metrics import structural_similarity_index, zero_mean_correlation
from sim.optics.camera_geometry import ImageArray
from sim.optics.height.height_map import HeightMaps
from sim.optics.render.nominal_renderer import GREY_LEVEL, NominalRenderer
from sim.optics.sensor_camera import camera_geometry
from sim.sensor.sensor import load_sensor
from sim.studies.accuracy.configurations import (
    FULL,
    FULL_REFERENCE,
    SHIFTED,
    SHORT,
    SHORT_REFERENCE,
    reseeded,
)
from sim.studies.accuracy.figure import draw_study
from sim.studies.accuracy.force_error_table import measure_force_errors
from sim.studies.accuracy.force_limit import PressStore
from sim.studies.accuracy.scenes import HELD_OUT, SEEN_BEFORE
from sim.studies.accuracy.study import Row, Study, study
from sim.studies.accuracy.tables import study_section
from sim.studies.accuracy.tolerance_check import TITLE, check_tolerances, section
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import complain, say, show_table, writable_folder, write_json
from tacauchy_rig.cli.scene_options import SceneTerms, scene_of
from tacauchy_rig.cli.studies.accuracy_page import OLD_PROMISES, PROMISES, study_name, write_page
from tacauchy_rig.versions import versions

_PROMISES = {
    PROMISES: (HELD_OUT, TITLE, ""),
    OLD_PROMISES: (
        SEEN_BEFORE,
        f"{TITLE}, on scenes that were judged before",
        " They were looked at while the method was made: the other ten decide.",
    ),
}
_PAPER_PUNCH = "cylinder:diameter=5mm,fillet=0.1mm"
PRESSES = "presses"


def accuracy(
    out: Annotated[Path, typer.Option("--out", help="Folder for figures, tables and JSON.")] = Path(
        "accuracy"
    ),
    sensor: Annotated[str, typer.Option("--sensor")] = "gelsight-mini",
    indenter: Annotated[str, typer.Option("--indenter")] = _PAPER_PUNCH,
    force: Annotated[str, typer.Option("--force")] = "4.7332N",
    full: Annotated[bool, typer.Option("--full", help="Measure many more settings.")] = False,
    seed: Annotated[int, typer.Option("--seed", help="Other meshes of the same sizes.")] = 0,
    promise: Annotated[
        bool, typer.Option("--promise", help="Judge --tolerance on twenty scenes instead.")
    ] = False,
    presets: Annotated[
        Path | None,
        typer.Option(
            "--presets", metavar="FILE", help="Measure the table that --tolerance uses instead."
        ),
    ] = None,
    page: Annotated[
        Path | None,
        typer.Option("--page", metavar="FILE", help="Write a page of all that is in the folder."),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Press with many settings and show each one's error against its time."""
    writable_folder(out)
    if presets is not None:
        facts = _measure_presets(presets, out)
    elif promise:
        facts = _judge_promises(out)
    else:
        terms = SceneTerms(indenter=indenter, sensor=sensor, force=force)
        facts = _study(terms, out, full=full, seed=seed)
    write_json(json_file, facts)
    if page is not None:
        for file in write_page(page, out):
            say(str(file))


def _study(terms: SceneTerms, out: Path, *, full: bool, seed: int) -> dict[str, Any]:
    scene, gel = scene_of(terms), load_sensor(terms.sensor or "")
    found = study(
        scene,
        [reseeded(each, seed) for each in (FULL if full else SHORT)],
        camera_geometry(gel),
        render=NominalRenderer(gel),
        similarity=_similarity,
        reference=reseeded(FULL_REFERENCE if full else SHORT_REFERENCE, seed),
        shifted=SHIFTED if seed == 0 else (),
        on_progress=lambda text: complain(f"  {text}"),
    )
    text = f"{terms.indenter} into {terms.sensor} at {terms.force}"
    name = study_name(seed)
    command = " ".join(
        ["tacauchy-rig accuracy", *(["--full"] if full else []), f"--seed {seed} --out {out}"]
    )
    section = study_section(found, scene=text, command=command)
    facts = {**_facts(found, scene_text=text, seed=seed), "section": asdict(section)}
    show_table(section)
    for row in found.rows:
        if row.failure:
            complain(f"{row.configuration.name}: {row.failure}")
    files = [*draw_study(found, folder=out, name=name), out / f"{name}.json"]
    write_json(files[-1], facts)
    for file in files:
        say(str(file))
    return facts


def _measure_presets(file: Path, out: Path) -> dict[str, Any]:
    store = PressStore(folder=out / PRESSES)
    rows = measure_force_errors(file, store, on_progress=lambda text: complain(f"  {text}"))
    say(str(file))
    return {"rows": rows, "versions": versions()}


def _judge_promises(out: Path) -> dict[str, Any]:
    command = f"tacauchy-rig accuracy --promise --out {out}"
    facts: dict[str, Any] = {"versions": versions()}
    for name, (scenes, title, note) in _PROMISES.items():
        found = check_tolerances(
            PressStore(folder=out / PRESSES),
            scenes,
            on_progress=lambda text: complain(f"  {text}"),
        )
        table = section(found, command=command, title=title, note=note)
        show_table(table)
        facts[name] = {"section": asdict(table), "versions": versions()}
        write_json(out / name, facts[name])
        say(str(out / name))
    return facts


def _similarity(exact: ImageArray, found: ImageArray, maps: HeightMaps) -> tuple[float, float]:
    inside = maps.contact
    changes = [image.astype(np.float64)[inside] - GREY_LEVEL for image in (exact, found)]
    return structural_similarity_index(exact, found), zero_mean_correlation(*changes)


def _facts(found: Study, *, scene_text: str, seed: int) -> dict[str, Any]:
    return {
        "scene": scene_text,
        "seed": seed,
        "reference_error_bars": found.bars,
        "reference": _row_facts(found.reference),
        "rows": [_row_facts(row) for row in found.rows],
        "versions": versions(),
    }


def _row_facts(row: Row) -> dict[str, Any]:
    return {**asdict(row), "wall_s": row.wall_s, "time_s": row.time_s}
