"""Meshes: orientation, numbers, storage, and that fTetWild works at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.effects.presets import PAPER_SIZING, mesh_for
from sim.mesh.revolved import Grading, revolved_mesh
from sim.mesh.symmetry import MirrorSymmetry
from sim.mesh.tet_mesh import (
    TetMesh,
    cache_folder,
    oriented,
    read_mesh,
    smallest_dihedral_deg,
    stored_mesh,
    write_mesh,
)
from sim.mesh.tetwild import WildSizing, edge_length_at, pad_surface, wild_mesh
from sim.scene.indenter import Cylinder
from sim.scene.pad import BoxPad, DiscPad, Pad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import load_sensor
from sim.studies.paper.presses import mesh_statistics
from tacauchy_rig.core.errors import ConfigError, RecordError

BOX = BoxPad(size_x_m=20e-3, size_y_m=24e-3, height_m=4e-3)


def volume(vertices: np.ndarray, tets: np.ndarray) -> float:
    """Return the volume of a mesh [m^3]; negative tetrahedra would subtract."""
    corners = vertices[tets]
    return float(np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6.0)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    x=st.floats(-5e-3, 5e-3),
    y=st.floats(-5e-3, 5e-3),
    sectors=st.integers(4, 20),
    growth=st.floats(1.4, 2.2),
)
def test_revolved_box_fills_the_box(x: float, y: float, sectors: int, growth: float) -> None:
    """Wherever the axis stands: positive tetrahedra that fill the box, and nodes on the rim."""
    grading = Grading(start_m=2e-3, end_m=2e-3, size_m=0.3e-3, growth=growth)
    mesh = revolved_mesh(
        BOX, grading, centre_m=(x, y), sector_count=sectors, name="box", symmetry=MirrorSymmetry()
    )
    corners = mesh.vertices[mesh.tets]
    assert np.linalg.det(corners[:, 1:] - corners[:, :1]).min() > 0.0
    assert volume(mesh.vertices, mesh.tets) == pytest.approx(20e-3 * 24e-3 * 4e-3, rel=1e-9)
    top = mesh.vertices[mesh.vertices[:, 2] > 4e-3 - 1e-9, :2]
    radius = np.hypot(top[:, 0] - x, top[:, 1] - y)
    assert np.sum(np.abs(radius - 2e-3) < 1e-9) >= 8


@pytest.mark.parametrize(("y", "copies"), [(0.0, 4), (2e-3, 2)])
def test_planes_through_the_axis_leave_a_quarter_or_half(y: float, copies: int) -> None:
    """The part's volume, and it lies beside the planes that mirror it; off centre one does."""
    grading = Grading(start_m=2e-3, end_m=2e-3, size_m=0.3e-3)
    mesh = revolved_mesh(BOX, grading, centre_m=(0.0, y), sector_count=16, name="box")
    assert (mesh.symmetry.mirror_x, mesh.symmetry.copies) == (True, copies)
    assert mesh.vertices[:, : copies // 2].min() >= 0.0
    part = 20e-3 * 24e-3 * 4e-3 / copies
    assert volume(mesh.vertices, mesh.tets) == pytest.approx(part, rel=1e-9)


def test_negative_tetrahedra_are_turned() -> None:
    """FTetWild's orientation is the other one; unused vertices go."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9]])
    tets = np.array([[0, 2, 1, 3]])
    mesh = oriented(TetMesh(vertices=vertices, tets=tets, name="one"))
    assert volume(mesh.vertices, mesh.tets) == pytest.approx(1.0 / 6.0)
    assert len(mesh.vertices) == 4


@pytest.mark.parametrize("pad", [BOX, DiscPad(radius_m=8e-3, height_m=3e-3)])
def test_pad_surface_is_closed(pad: Pad) -> None:
    """Every edge belongs to two faces, and the volume is positive."""
    vertices, faces = pad_surface(pad, spacing_m=1e-3)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert set(counts) == {2}
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert np.sum(np.cross(a, b) * c) > 0.0


def test_sizing_field_is_the_papers() -> None:
    """Fine in the middle of the contact surface, coarse at its edge and below it."""
    points = np.array([[0.0, 0, 4e-3], [9.9e-3, 0, 4e-3], [0, 0, 3.3e-3], [5e-3, 0, 4e-3]])
    lengths = edge_length_at(points, BOX, WildSizing())
    assert lengths == pytest.approx([0.8e-3, 3.2e-3, 3.2e-3, 2.0e-3])


def test_paper_mesh_ships(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The GelSight Mini's paper mesh comes with the program: no fTetWild run, no cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    sensor = load_sensor("gelsight-mini")
    scene = Scene(
        pad=sensor.pad,
        material=sensor.material,
        indenter=Cylinder(diameter_m=5e-3),
        target=Target(depth_m=1e-3),
        preset=Preset.PAPER,
    )
    mesh = mesh_for(scene)
    statistics = mesh_statistics(mesh)
    assert 1000 < statistics.tet_count < 3000
    assert 0.6e-3 < statistics.centre_edge_m < 1.0e-3
    assert smallest_dihedral_deg(mesh) > 10.0
    assert not cache_folder().exists()


@pytest.mark.slow
def test_meshing_works_and_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """FTetWild meshes a small pad once; the second time the file answers."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    pad = BoxPad(size_x_m=6e-3, size_y_m=6e-3, height_m=3e-3)
    mesh = stored_mesh("small", "key", lambda: wild_mesh(pad, PAPER_SIZING, name="small"))
    assert volume(mesh.vertices, mesh.tets) == pytest.approx(6e-3 * 6e-3 * 3e-3, rel=0.05)
    again = stored_mesh("small", "key", lambda: pytest.fail("meshed twice"))
    assert again.content_hash == mesh.content_hash


def test_a_mesh_file_keeps_all_and_a_damaged_one_is_named(tmp_path: Path) -> None:
    """Layers too, which the hash covers; a changed or torn file is refused with what to do."""
    mesh = revolved_mesh(
        BOX,
        Grading(start_m=2e-3, end_m=2e-3, size_m=0.5e-3),
        centre_m=(0.0, 0.0),
        sector_count=8,
        name="box",
        interface_shares=(0.9,),
    )
    path = tmp_path / "mesh.npz"
    write_mesh(path, mesh)
    kept = read_mesh(path)
    assert kept.content_hash == mesh.content_hash
    np.testing.assert_array_equal(kept.labels, mesh.labels)
    assert kept.content_hash != replace(mesh, layers=None).content_hash
    np.savez(
        path, vertices=mesh.vertices * 2, tets=mesh.tets, name="x", content_hash=mesh.content_hash
    )
    with pytest.raises(RecordError, match="damaged"):
        read_mesh(path)
    path.write_bytes(b"torn")
    with pytest.raises(RecordError, match="cannot be read"):
        read_mesh(path)


def test_impossible_pads_are_refused() -> None:
    """Negative lengths and domes that cut through the pad."""
    with pytest.raises(ConfigError, match="not positive"):
        DiscPad(radius_m=-1e-3, height_m=1e-3)
    with pytest.raises(ConfigError, match="corner"):
        BoxPad(size_x_m=20e-3, size_y_m=20e-3, height_m=2e-3, dome_radius_x_m=20e-3)
