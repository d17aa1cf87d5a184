"""``tacauchy-rig accuracy``: what accuracy costs in time, for one press."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from reports.figures.accuracy import CostPoint, Panel, draw_accuracy
from reports.metrics import structural_similarity_index, zero_mean_correlation
from sim.accuracy.configurations import FULL, SHORT, reseeded
from sim.accuracy.study import Row, Study, study
from sim.elements import ElementOrder
from sim.optics.geometry import CameraGeometry, ImageArray
from sim.optics.height_map import HeightMaps
from sim.optics.render import TactileRenderer
from sim.sensor import Sensor, load_sensor
from tacauchy_rig.cli.optics import nominal_model
from tacauchy_rig.cli.options import JsonFile
from tacauchy_rig.cli.output import complain, say, writable_folder, write_json
from tacauchy_rig.cli.pipeline import camera_geometry
from tacauchy_rig.cli.scene_options import SceneTerms, scene_of
from tacauchy_rig.cli.versions import versions

_PAPER_PUNCH = "cylinder:diameter=5mm,fillet=0.1mm"
_GREY_LEVEL = 110
_PANELS = (
    Panel(quantity="force", title="$F_z$ at equal depth"),
    Panel(quantity="depth", title="Depth at equal $F_z$"),
    Panel(quantity="pressure", title="Largest pressure"),
    Panel(quantity="height", title="Height map (RMS)"),
    Panel(quantity="image", title="Image (1 \N{MINUS SIGN} SSIM)"),
)


def accuracy(
    out: Annotated[Path, typer.Option("--out", help="Folder for figure, table and JSON.")] = Path(
        "accuracy"
    ),
    sensor: Annotated[str, typer.Option("--sensor")] = "gelsight-mini",
    indenter: Annotated[str, typer.Option("--indenter")] = _PAPER_PUNCH,
    force: Annotated[str, typer.Option("--force")] = "4.7332N",
    full: Annotated[bool, typer.Option("--full", help="Measure many more settings.")] = False,
    seed: Annotated[int, typer.Option("--seed", help="Other meshes of the same sizes.")] = 0,
    json_file: JsonFile = None,
) -> None:
    """Press with many settings and show each one's error against its time."""
    scene = scene_of(SceneTerms(indenter=indenter, sensor=sensor, force=force))
    gel = load_sensor(sensor)
    writable_folder(out)
    configurations = [reseeded(each, seed) for each in (FULL if full else SHORT)]
    found = study(
        scene,
        configurations,
        camera_geometry(gel),
        render=_Renderer(gel),
        similarity=_similarity,
        on_progress=lambda text: complain(f"  {text}"),
    )
    _show(found)
    files = _draw(found, out)
    facts = _facts(found, scene_text=f"{indenter} into {sensor} at {force}", seed=seed)
    write_json(out / "accuracy.json", facts)
    write_json(json_file, facts)
    for file in (*files, out / "accuracy.json"):
        say(str(file))


class _Renderer:
    """The image that a sensor's nominal optics give over an evenly grey no-contact frame."""

    def __init__(self, sensor: Sensor) -> None:
        self._model = nominal_model(sensor)
        self._geometry: CameraGeometry = camera_geometry(sensor)

    def __call__(self, maps: HeightMaps) -> ImageArray:
        shape = (self._geometry.height, self._geometry.width, 3)
        background = np.full(shape, _GREY_LEVEL, dtype=np.uint8)
        return TactileRenderer(background, maps.rest, self._model, self._geometry).render(
            maps.loaded
        )


def _similarity(exact: ImageArray, found: ImageArray, maps: HeightMaps) -> tuple[float, float]:
    inside = maps.contact
    changes = [image.astype(np.float64)[inside] - _GREY_LEVEL for image in (exact, found)]
    return structural_similarity_index(exact, found), zero_mean_correlation(*changes)


def _draw(found: Study, folder: Path) -> list[Path]:
    points = [
        CostPoint(
            wall_s=row.wall_s,
            errors=row.errors,
            on_front=row.on_front,
            is_linear_element=row.configuration.element is ElementOrder.P1,
            label=row.configuration.name if row.configuration.is_preset or row.on_front else "",
        )
        for row in found.rows
        if not row.failure
    ]
    return draw_accuracy(points, found.bars, _PANELS, folder=folder)


def _show(found: Study) -> None:
    table = Table(title="What accuracy costs in time", caption=_caption(found))
    for name in ("settings", "tets", "its", "time (s)", "F_z", "depth", "pressure", "radius"):
        table.add_column(name, justify="left" if name == "settings" else "right")
    for name in ("height", "1-SSIM", "ZNCC", "front"):
        table.add_column(name, justify="right")
    for row in sorted(found.rows, key=lambda row: (not row.failure, row.wall_s)):
        table.add_row(*_cells(row))
    Console().print(table)
    for row in found.rows:
        if row.failure:
            complain(f"{row.configuration.name}: {row.failure}")


def _cells(row: Row) -> tuple[str, ...]:
    if row.failure:
        return (row.configuration.name, *("-",) * 11)
    errors = row.errors
    signed = [f"{errors[name]:+.2%}" for name in ("force", "depth", "pressure", "radius")]
    return (
        row.configuration.name,
        str(row.tet_count),
        str(row.newton_iterations),
        f"{row.wall_s:.2f}",
        *signed,
        f"{errors['height']:.2%}",
        f"{errors['image']:.4f}",
        f"{row.zncc_contact:.4f}",
        "*" if row.on_front else "",
    )


def _caption(found: Study) -> str:
    bars = ", ".join(f"{name} {bar:.2%}" for name, bar in found.bars.items())
    return (
        f"Errors against preset reference ({found.reference.wall_s:.1f} s), whose own error is "
        f"believed to be at most: {bars}."
    )


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
    return {**asdict(row), "wall_s": row.wall_s}
