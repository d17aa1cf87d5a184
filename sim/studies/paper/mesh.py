"""The numbers of the paper's mesh table, and what a search for its pad and l_r found."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from sim.effects.presets import PAPER_SIZING, mesh_for
from sim.mesh.elements import boundary_faces
from sim.mesh.tet_mesh import TetMesh, mesh_key, stored_mesh
from sim.mesh.tetwild import WildSizing, wild_mesh
from sim.scene.pad import Pad
from sim.scene.scene import Preset, Scene
from sim.studies.paper.claims import claims
from tacauchy_rig.core.arrays import FloatArray, IntArray

# The contact surface's edges are measured so near the pad's middle [m] and above this share of its
# height (paper, section IV-A).
_CENTRE_M = 2.5e-3
_UPPER_SHARE = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshStatistics:
    """The numbers of the paper's mesh table.

    Attributes:
        centre_edge_m: Mean length of the contact surface's edges within 2.5 mm of the middle.
    """

    tet_count: int
    vertex_count: int
    surface_vertex_count: int
    surface_face_count: int
    centre_edge_m: float


def mesh_statistics(mesh: TetMesh) -> MeshStatistics:
    """Measure a mesh as the paper's section IV-A does."""
    faces, _ = boundary_faces(mesh.tets)
    return MeshStatistics(
        tet_count=len(mesh.tets),
        vertex_count=len(mesh.vertices),
        surface_vertex_count=len(np.unique(faces)),
        surface_face_count=len(faces),
        centre_edge_m=_centre_edge(mesh.vertices, faces),
    )


def _centre_edge(vertices: FloatArray, faces: IntArray) -> float:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    middles = vertices[edges].mean(axis=1)
    centre = np.hypot(middles[:, 0], middles[:, 1]) < _CENTRE_M
    kept = edges[centre & (middles[:, 2] > _UPPER_SHARE * vertices[:, 2].max())]
    lengths = np.linalg.norm(vertices[kept[:, 0]] - vertices[kept[:, 1]], axis=1)
    return float(lengths.mean()) if len(lengths) else float("nan")


def mesh_numbers(coarse: MeshStatistics, fine: MeshStatistics) -> dict[str, float]:
    """Return the table by claim; density is the square of the ratio of edge lengths."""
    return {
        "mesh.tets_plain": coarse.tet_count,
        "mesh.tets": fine.tet_count,
        "mesh.growth": fine.tet_count / coarse.tet_count,
        "mesh.vertices": fine.vertex_count,
        "mesh.surface_vertices": fine.surface_vertex_count,
        "mesh.surface_faces": fine.surface_face_count,
        "mesh.edge_plain": coarse.centre_edge_m * 1e3,
        "mesh.edge": fine.centre_edge_m * 1e3,
        "mesh.density": (coarse.centre_edge_m / fine.centre_edge_m) ** 2,
    }


def preset_statistics(scene: Scene) -> tuple[MeshStatistics, MeshStatistics]:
    """Measure preset paper's mesh of a scene's pad, without its fine region and with it."""
    fine = mesh_for(replace(scene, preset=Preset.PAPER))
    return mesh_statistics(_baseline_mesh(scene.pad)), mesh_statistics(fine)


def _baseline_mesh(pad: Pad) -> TetMesh:
    """Return the pad meshed with the coarse edge length everywhere."""
    sizing: WildSizing = replace(PAPER_SIZING, fine_m=PAPER_SIZING.coarse_m)
    key = mesh_key(pad, sizing)
    return stored_mesh(
        "paper-unrefined", key, lambda: wild_mesh(pad, sizing, name=f"fTetWild, unrefined, {key}")
    )


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


def read_trials(file: Path) -> list[Trial]:
    """Read a search that was kept, the nearest first; empty where there is none."""
    if not file.exists():
        return []
    found = TypeAdapter(list[Trial]).validate_json(file.read_text("utf-8"))
    return sorted(found, key=lambda trial: trial.miss)
