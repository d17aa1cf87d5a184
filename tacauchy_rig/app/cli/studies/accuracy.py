"""``tacauchy-rig accuracy``: what accuracy costs in time, for one press."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim.scene.scene import SceneTerms
from tacauchy_rig.app.cli.options import JsonFile
from tacauchy_rig.app.cli.output import (
    complain,
    say,
    show_table,
    writable_folder,
    write_json,
    write_text,
)
from tacauchy_rig.core.arrays import ImageArray
from tacauchy_rig.core.errors import RecordError
from tacauchy_rig.core.versions import versions

if TYPE_CHECKING:
    from sim.optics.height.height_map import HeightMaps
    from sim.studies.accuracy.force_limit import PressStore
    from tacauchy_rig.core.tables import Table


PROMISES = "promises.json"
_PAPER_PUNCH = "cylinder:diameter=5mm,fillet=0.1mm"
_IMAGE = "accuracy.png"
_TITLE = "What a tolerance promises"
_JUDGED_BEFORE = "promises-judged-before.json"
_NOTE = (
    "`press`, `plan`, `replay` and `replay.tolerance` in a configuration take a tolerance such as "
    "0.02N or 1% and choose the cheapest preset that is believed to keep it. The command below a "
    "table makes it again."
)


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
    page: Annotated[
        Path | None,
        typer.Option("--page", metavar="FILE", help="Write a page of all that is in the folder."),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Press with many settings and show each one's error against its time.

    Example: tacauchy-rig study accuracy --sensor digit --force 2N
    """
    writable_folder(out)
    if promise:
        facts = _check_tolerances(out)
    else:
        terms = SceneTerms(indenter=indenter, sensor=sensor, force=force)
        facts = _study(terms, out, full=full, seed=seed)
    write_json(json_file, facts)
    if page is not None:
        for file in write_page(page, out):
            say(str(file))


def study_name(seed: int) -> str:
    """Return how a study's files are called."""
    return "accuracy" if seed == 0 else f"accuracy-seed-{seed}"


def _told(text: str) -> None:
    complain(f"  {text}")


def _study(terms: SceneTerms, out: Path, *, full: bool, seed: int) -> dict[str, Any]:
    from sim.press_command import scene_of
    from sim.sensor.sensor import load_sensor
    from sim.studies.accuracy.configurations import (
        FULL,
        REFERENCE,
        SHIFTED,
        SHORT,
        reseeded,
    )
    from sim.studies.accuracy.figure import draw_study
    from sim.studies.accuracy.study import study
    from sim.studies.accuracy.tables import study_table
    from sim.studies.nominal_renderer import nominal_renderer

    scene, gel = scene_of(terms), load_sensor(terms.sensor or "")
    found = study(
        scene,
        [reseeded(each, seed) for each in (FULL if full else SHORT)],
        gel.camera,
        render=nominal_renderer(gel),
        similarity=_similarity,
        reference=reseeded(REFERENCE, seed),
        shifted=SHIFTED if seed == 0 else (),
        on_progress=_told,
    )
    text = f"{terms.indenter} into {terms.sensor} at {terms.force}"
    command = f"tacauchy-rig accuracy{' --full' if full else ''} --seed {seed} --out {out}"
    table = study_table(found, scene=text, command=command)
    facts = {
        "scene": text,
        "seed": seed,
        "reference_error_bars": found.bars,
        "reference": found.reference.as_json(),
        "rows": [row.as_json() for row in found.rows],
        "versions": versions(),
        "section": asdict(table),
    }
    show_table(table)
    for row in found.rows:
        if row.failure:
            complain(f"{row.configuration.name}: {row.failure}")
    name = study_name(seed)
    files = [*draw_study(found, folder=out, name=name), out / f"{name}.json"]
    write_json(files[-1], facts)
    for file in files:
        say(str(file))
    return facts


def _similarity(exact: ImageArray, found: ImageArray, maps: HeightMaps) -> tuple[float, float]:
    import numpy as np

    from reports.scores.metrics import structural_similarity_index, zero_mean_correlation
    from sim.optics.render.renderer import GREY_LEVEL

    inside = maps.contact
    changes = [image.astype(np.float64)[inside] - GREY_LEVEL for image in (exact, found)]
    return structural_similarity_index(exact, found), zero_mean_correlation(*changes)


def _check_tolerances(out: Path) -> dict[str, Any]:
    from sim.studies.accuracy.scenes import HELD_OUT, SEEN_BEFORE
    from sim.studies.accuracy.tables import tolerance_table
    from sim.studies.accuracy.tolerance_check import check_tolerances

    command = f"tacauchy-rig accuracy --promise --out {out}"
    facts: dict[str, Any] = {"versions": versions()}
    held_out = {
        PROMISES: (HELD_OUT, _TITLE, ""),
        _JUDGED_BEFORE: (
            SEEN_BEFORE,
            f"{_TITLE}, on scenes that were judged before",
            " They were looked at while the method was made: the other ten decide.",
        ),
    }
    for name, (scenes, title, note) in held_out.items():
        found = check_tolerances(_store(out), scenes, on_progress=_told)
        table = tolerance_table(found, command=command, title=title, note=note)
        show_table(table)
        facts[name] = {"section": asdict(table), "versions": versions()}
        write_json(out / name, facts[name])
        say(str(out / name))
    return facts


def _store(out: Path) -> PressStore:
    from sim.studies.accuracy.force_limit import PressStore

    return PressStore(folder=out / "presses")


def write_page(page: Path, folder: Path) -> list[Path]:
    """Write a page, and its figure into ``images`` beside it, of what a folder holds.

    Raises:
        RecordError: The folder has no study of seed 0, or the page cannot be written.
    """
    from tacauchy_rig.core.page import criteria_page

    first = _read(folder / f"{study_name(0)}.json")
    others = [_read(file) for file in sorted(folder.glob(f"{study_name(0)}-seed-*.json"))]
    tables = [
        _table(first),
        *(_seed_table(first, other, folder) for other in others),
        *(
            _table(_read(folder / name))
            for name in (PROMISES, _JUDGED_BEFORE)
            if (folder / name).exists()
        ),
    ]
    text = criteria_page(
        tables,
        title="What accuracy costs in time",
        note=_NOTE,
        image=f"images/{_IMAGE}",
        command=f"tacauchy-rig accuracy --out {folder} --page {page}",
    )
    write_text(page, text)
    image = page.parent / "images" / _IMAGE
    image.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(folder / _IMAGE, image)
    return [page, image]


def _seed_table(first: dict[str, Any], other: dict[str, Any], folder: Path) -> Table:
    from sim.studies.accuracy.study import error_bar
    from sim.studies.accuracy.tables import seed_table

    errors, others = (
        {row["configuration"]["name"]: row["errors"] for row in facts["rows"]}
        for facts in (first, other)
    )
    references = first["reference_error_bars"]
    bars = {
        row["configuration"]["name"]: {
            name: error_bar(references[name], error, row["chances"][name])
            for name, error in row["errors"].items()
        }
        for row in first["rows"]
    }
    seed = other["seed"]
    command = f"tacauchy-rig accuracy --seed {seed} --out {folder}"
    return seed_table(errors, others, bars, seed=seed, command=command)


def _table(facts: dict[str, Any]) -> Table:
    from tacauchy_rig.core.tables import Table

    given = facts["section"]
    rows = tuple(tuple(row) for row in given["rows"])
    return Table(**{**given, "columns": tuple(given["columns"]), "rows": rows})


def _read(file: Path) -> dict[str, Any]:
    try:
        content: dict[str, Any] = json.loads(file.read_text("utf-8"))
    except OSError as error:
        raise RecordError(
            f"{file}: cannot be read: {error.strerror}",
            remedy="run `tacauchy-rig accuracy` with the same --out first",
        ) from error
    return content
