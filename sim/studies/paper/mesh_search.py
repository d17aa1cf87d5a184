"""Search the pad and l_r that would give the paper's mesh table."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pydantic import TypeAdapter

from sim.effects.footprint_presets import diagonal
from sim.effects.presets import PAPER_SIZING
from sim.mesh.tet_mesh import TetMesh
from sim.mesh.tetwild import WildSizing, wild_mesh
from sim.scene.pad import BoxPad, ParametricPad
from sim.sensor.sensor import load_sensor
from sim.studies.paper.claims import claims
from sim.studies.paper.mesh_statistics import mesh_statistics
from sim.studies.paper.mesh_table import mesh_numbers

# Thicknesses of a flat pad of the GelSight Mini's outline [m]: its gel's, and two thinner ones,
# since 661 tetrahedra with edges of 1.82 mm fill a quarter of the gel.
_HEIGHTS_M = (4e-3, 3e-3, 2e-3)
# l_r: l_g of 3.2 mm over the bounding box's diagonal, fTetWild's own 0.05, and between.
_SHARES = (0.05, 0.065, 0.08, 0.0972)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One pad and l_r, meshed with and without the fine region.

    Attributes:
        pad: In words.
        share: l_r, the coarse edge length over the bounding box's diagonal.
        found: The paper's table, by claim.
    """

    pad: str
    share: float
    found: dict[str, float]

    @property
    def miss(self) -> float:
        """Root mean square of the logarithm of ours over the paper's, as a share."""
        logs = [math.log(value / claims()[name].value) for name, value in self.found.items()]
        return math.expm1(math.sqrt(sum(each**2 for each in logs) / len(logs)))


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
            yield Trial(pad=name, share=share, found=found)


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


def trials_text(trials: list[Trial]) -> str:
    """Return trials as JSON."""
    return json.dumps([asdict(trial) for trial in trials], indent=1) + "\n"


def read_trials(file: Path) -> list[Trial]:
    """Read a search that was kept, the nearest first; empty where there is none."""
    if not file.exists():
        return []
    found = TypeAdapter(list[Trial]).validate_json(file.read_text("utf-8"))
    return sorted(found, key=lambda trial: trial.miss)
