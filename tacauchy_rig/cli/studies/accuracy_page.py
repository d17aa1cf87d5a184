"""The page of what accuracy costs, from the files that ``accuracy`` left in a folder."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from sim.studies.accuracy.study import error_bar
from sim.studies.accuracy.tables import presets_section, seed_section
from tacauchy_rig.cli.output import write_text
from tacauchy_rig.errors import RecordError
from tacauchy_rig.page import criteria_page
from tacauchy_rig.tables import Table
from tacauchy_rig.versions import machine, versions

PROMISES, OLD_PROMISES = "promises.json", "promises-judged-before.json"
_IMAGE = "accuracy.png"
_NOTE = (
    "`press`, `plan`, `replay` and `replay.tolerance` in a configuration take a tolerance such as "
    "0.02N or 1% and choose the cheapest preset that is believed to keep it. The command below a "
    "table makes it again."
)


def study_name(seed: int) -> str:
    """Return how a study's files are called."""
    return "accuracy" if seed == 0 else f"accuracy-seed-{seed}"


def write_page(page: Path, folder: Path) -> list[Path]:
    """Write a page, and its figure into ``images`` beside it, of what a folder holds.

    Raises:
        RecordError: The folder has no study of seed 0, or the page cannot be written.
    """
    first = _read(folder / f"{study_name(0)}.json")
    sections = [
        _section(first),
        *_seeds(first, folder),
        presets_section(command="tacauchy-rig accuracy --presets sim/force_errors.json"),
    ]
    sections += [
        _section(_read(folder / name))
        for name in (PROMISES, OLD_PROMISES)
        if (folder / name).exists()
    ]
    text = criteria_page(
        sections,
        title="What accuracy costs in time",
        note=_NOTE,
        image=f"images/{_IMAGE}",
        command=f"tacauchy-rig accuracy --out {folder} --page {page}",
        versions=versions(),
        machine=machine(),
    )
    write_text(page, text)
    image = page.parent / "images" / _IMAGE
    image.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(folder / _IMAGE, image)
    return [page, image]


def _seeds(first: dict[str, Any], folder: Path) -> list[Table]:
    sections = []
    for file in sorted(folder.glob(f"{study_name(0)}-seed-*.json")):
        other = _read(file)
        sections.append(
            seed_section(
                _errors(first),
                _errors(other),
                _bars(first),
                seed=other["seed"],
                command=f"tacauchy-rig accuracy --seed {other['seed']} --out {folder}",
            )
        )
    return sections


def _errors(facts: dict[str, Any]) -> dict[str, dict[str, float]]:
    return {row["configuration"]["name"]: row["errors"] for row in facts["rows"]}


def _bars(facts: dict[str, Any]) -> dict[str, dict[str, float]]:
    references = facts["reference_error_bars"]
    return {
        row["configuration"]["name"]: {
            name: error_bar(references[name], error, row["chances"][name])
            for name, error in row["errors"].items()
        }
        for row in facts["rows"]
    }


def _section(facts: dict[str, Any]) -> Table:
    given = dict(facts["section"])
    given["columns"] = tuple(given["columns"])
    given["rows"] = tuple(tuple(row) for row in given["rows"])
    return Table(**given)


def _read(file: Path) -> dict[str, Any]:
    try:
        content: dict[str, Any] = json.loads(file.read_text("utf-8"))
    except OSError as error:
        raise RecordError(
            f"{file}: cannot be read: {error.strerror}",
            remedy="run `tacauchy-rig accuracy` with the same --out first",
        ) from error
    return content
