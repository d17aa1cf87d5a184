"""Halving of edges, and vertices that come to lie on the top and on the rim."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.mesh.elements import boundary_faces
from sim.mesh.refinement import bisected, with_rim_fitted, with_top_fitted
from sim.mesh.revolved import Grading, revolved_mesh
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import TetMesh
from sim.scene.pad import BoxPad
from tacauchy_rig.core.arrays import FloatArray

PAD = BoxPad(
    size_x_m=10e-3, size_y_m=8e-3, height_m=2e-3, dome_radius_x_m=0.05, dome_radius_y_m=0.05
)
_OFF_M = 2e-5


def coarse() -> TetMesh:
    """Return the whole pad."""
    grading = Grading(start_m=1e-3, end_m=1e-3, size_m=0.5e-3)
    return revolved_mesh(
        PAD, grading, centre_m=(0.0, 0.0), sector_count=12, name="box", symmetry=MirrorSymmetry()
    )


def volumes(mesh: TetMesh) -> FloatArray:
    """Return six times the tetrahedra's volumes [m^3]."""
    corners = mesh.vertices[mesh.tets]
    return np.linalg.det(corners[:, 1:] - corners[:, :1])


def test_a_rough_top_is_laid_onto_the_pad() -> None:
    """Vertices that stray by less than the reach come back; the rest stays where it was."""
    mesh = coarse()
    heights = PAD.height_at(mesh.vertices[:, 0], mesh.vertices[:, 1])
    top = np.abs(mesh.vertices[:, 2] - heights) < 1e-9
    rough = mesh.vertices.copy()
    rough[top, 2] += np.random.default_rng(1).uniform(-_OFF_M, _OFF_M, int(top.sum()))
    fitted = with_top_fitted(replace(mesh, vertices=rough), PAD, reach_m=2.0 * _OFF_M)
    np.testing.assert_allclose(fitted.vertices[top, 2], heights[top], atol=1e-12)
    np.testing.assert_array_equal(fitted.vertices[~top], mesh.vertices[~top])


def test_a_rim_gets_nodes_and_no_element_is_flattened() -> None:
    """A circle between two rings of nodes: the near ones move onto it, volumes stay positive."""
    mesh, radius = coarse(), 1.1e-3
    angle = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    plan = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    rim = np.column_stack([plan, PAD.height_at(plan[:, 0], plan[:, 1])])
    fitted = with_rim_fitted(mesh, PAD, rim, reach_m=0.15e-3)
    moved = np.any(fitted.vertices != mesh.vertices, axis=1)
    assert moved.sum() >= 12
    at = np.hypot(fitted.vertices[moved, 0], fitted.vertices[moved, 1])
    np.testing.assert_allclose(at, radius, rtol=1e-5)
    assert np.all(volumes(fitted) >= 0.2 * volumes(mesh))
    assert with_rim_fitted(mesh, PAD, np.empty((0, 3)), reach_m=1e-3) is mesh


def test_halving_keeps_the_pad_and_meets_the_field() -> None:
    """Same volume, no hanging node, every edge short enough, nothing changed where it was."""

    def size_at(points: np.ndarray) -> np.ndarray:
        return np.asarray(0.4e-3 + 0.5 * np.linalg.norm(points - [2e-3, 1e-3, 2e-3], axis=1))

    before, mesh = coarse(), bisected(coarse(), size_at)
    assert volumes(mesh).min() > 0.0
    assert volumes(mesh).sum() == pytest.approx(volumes(before).sum(), rel=1e-12)
    areas = []
    for m in (before, mesh):
        a, b, c = (m.vertices[boundary_faces(m.tets)[0]][:, k] for k in range(3))
        areas.append(float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()))
    assert areas[1] == pytest.approx(areas[0], rel=1e-12)
    pairs = mesh.tets[:, [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]].reshape(-1, 2)
    ends = mesh.vertices[pairs]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert np.all(lengths <= 1.5 * size_at(ends.mean(axis=1)))
    assert mesh.content_hash == bisected(coarse(), size_at).content_hash
