"""``python -m tests.studies paper-mesh``: search the pad and l_r of the paper's mesh table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from sim.effects.mesh_choice import diagonal
from sim.effects.presets import PAPER_SIZING
from sim.mesh.tet_mesh import TetMesh
from sim.mesh.tetwild import WildSizing, wild_mesh
from sim.scene.pad import BoxPad, ParametricPad
from sim.sensor.sensor import load_sensor
from sim.studies.paper.kept import json_lines
from sim.studies.paper.presses import Trial, mesh_numbers, mesh_statistics, miss
from sim.studies.paper.study import SEARCH_FILE
from tacauchy_rig.app.cli.output import say, write_text

# Thicknesses of a flat pad of the GelSight Mini's outline [m]: its gel's, and two thinner ones,
# since 661 tetrahedra with edges of 1.82 mm fill a quarter of the gel.
_HEIGHTS_M = (4e-3, 3e-3, 2e-3)
# l_r: l_g of 3.2 mm over the bounding box's diagonal, fTetWild's own 0.05, and between.
_SHARES = (0.05, 0.065, 0.08, 0.0972)


def paper_mesh(
    benchmarks: Annotated[
        Path, typer.Option("--benchmarks", help="Folder of the benchmarks that are kept.")
    ] = Path("docs/results/benchmarks"),
) -> None:
    """Mesh every pad with every l_r, and keep what came out for `study paper`: five minutes.

    Example: python -m tests.studies paper-mesh
    """
    trials = []
    for trial in searched():
        trials.append(trial)
        off = miss(trial)
        say(f"  {trial['pad']}, l_r {trial['share']:g}: {off:.0%} off the paper's table")
    write_text(benchmarks / SEARCH_FILE, json_lines(trials), option="--benchmarks")


def _meshed(pad: ParametricPad, sizing: WildSizing) -> TetMesh:
    return wild_mesh(pad, sizing, name="search")


def searched(*, make: Callable[[ParametricPad, WildSizing], TetMesh] = _meshed) -> Iterator[Trial]:
    """Mesh every pad with every l_r; a run of minutes, and of other meshes each time."""
    for name, pad in _pads().items():
        for share in _SHARES:
            coarse_m = share * diagonal(pad)
            sizing = replace(PAPER_SIZING, coarse_m=coarse_m)
            plain = mesh_statistics(make(pad, replace(sizing, fine_m=coarse_m)))
            found = mesh_numbers(plain, mesh_statistics(make(pad, sizing)))
            yield {"pad": name, "share": share, "found": found}


def _pads() -> Mapping[str, ParametricPad]:
    domed = load_sensor("gelsight-mini").pad
    if not isinstance(domed, BoxPad):
        return {}
    flat = {
        f"flat, {height * 1e3:g} mm": BoxPad(
            size_x_m=domed.size_x_m, size_y_m=domed.size_y_m, height_m=height
        )
        for height in _HEIGHTS_M
    }
    return {"domed, of the sensor's file": domed, **flat}
