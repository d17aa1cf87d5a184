"""The numbers of the paper's mesh table, of any two meshes and of preset paper's."""

from __future__ import annotations

from dataclasses import replace

from sim.effects.presets import PAPER_SIZING, mesh_for
from sim.mesh.tet_mesh import TetMesh, mesh_key, stored_mesh
from sim.mesh.tetwild import WildSizing, wild_mesh
from sim.scene.pad import Pad
from sim.scene.scene import Preset, Scene
from sim.studies.paper.mesh_statistics import MeshStatistics, mesh_statistics


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
