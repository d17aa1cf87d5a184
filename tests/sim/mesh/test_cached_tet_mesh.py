"""Meshes: their type, their files, and what their elements make of a pad."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.effects.presets import PAPER_SIZING, mesh_for
from sim.mesh.cached_tet_mesh import (
    TetMesh,
    cache_folder,
    oriented,
    read_mesh,
    smallest_dihedral_deg,
    stored_mesh,
    tet_volumes,
    write_mesh,
)
from sim.mesh.clamping_and_sparsity import Discretisation, discretise
from sim.mesh.elements import (
    ElementOrder,
    boundary_faces,
    linear_facets,
    quadratic_nodes,
    reference_element,
)
from sim.mesh.mirror_symmetry import MirrorSymmetry, WholeSurface
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.mesh.tetwild import WildSizing, edge_length_at, pad_surface, wild_mesh
from sim.scene.indenter import Cylinder
from sim.scene.pad import BoxPad, DiscPad, Pad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.sensor import load_sensor
from sim.studies.paper.presses import mesh_statistics
from tacauchy_rig.core.errors import ConfigError, RecordError

BOX = BoxPad(size_x_m=20e-3, size_y_m=24e-3, height_m=4e-3)


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
    volumes = tet_volumes(mesh.vertices, mesh.tets)
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(20e-3 * 24e-3 * 4e-3, rel=1e-9)
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
    assert tet_volumes(mesh.vertices, mesh.tets).sum() == pytest.approx(part, rel=1e-9)


def test_negative_tetrahedra_are_turned() -> None:
    """FTetWild's orientation is the other one; unused vertices go."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9]])
    tets = np.array([[0, 2, 1, 3]])
    mesh = oriented(TetMesh(vertices=vertices, tets=tets, name="one"))
    assert tet_volumes(mesh.vertices, mesh.tets).sum() == pytest.approx(1.0 / 6.0)
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
    assert 1000 < statistics["tets"] < 3000
    assert 0.6 < statistics["edge"] < 1.0
    assert smallest_dihedral_deg(mesh) > 10.0
    assert not cache_folder().exists()


@pytest.mark.slow
def test_meshing_works_and_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """FTetWild meshes a small pad once; the second time the file answers."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    pad = BoxPad(size_x_m=6e-3, size_y_m=6e-3, height_m=3e-3)
    mesh = stored_mesh("small", "key", lambda: wild_mesh(pad, PAPER_SIZING, name="small"))
    volume = tet_volumes(mesh.vertices, mesh.tets).sum()
    assert volume == pytest.approx(6e-3 * 6e-3 * 3e-3, rel=0.05)
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


X, Y, Z = 8e-3, 6e-3, 2e-3
PAD = BoxPad(size_x_m=X, size_y_m=Y, height_m=Z)


def quarter(order: ElementOrder) -> tuple[TetMesh, Discretisation]:
    """Return a quarter of a box."""
    grading = Grading(start_m=1e-3, end_m=1e-3, size_m=0.6e-3)
    mesh = revolved_mesh(PAD, grading, centre_m=(0.0, 0.0), sector_count=8, name="box")
    return mesh, discretise(mesh, order=order)


@pytest.mark.parametrize("order", list(ElementOrder))
def test_a_quarter_has_a_quarters_gel(order: ElementOrder) -> None:
    """Volume, and the touchable faces: top and outer sides, neither base nor mirror planes."""
    _, part = quarter(order)
    assert part.volumes.sum() == pytest.approx(X * Y * Z / 4, rel=1e-9)
    assert part.face_areas.sum() == pytest.approx(X * Y / 4 + (X + Y) / 2 * Z, rel=1e-9)
    assert np.all(part.nodes[part.clamped, 2] == 0.0)
    highest = part.nodes[part.elements[part.touched_element], 2].max()
    assert highest == pytest.approx(Z)


@pytest.mark.parametrize("order", list(ElementOrder))
def test_only_what_is_free_is_unknown(order: ElementOrder) -> None:
    """Clamped nodes have no unknowns, nodes on a mirror plane none across it."""
    mesh, part = quarter(order)
    held = mesh.symmetry.on_plane(part.nodes, X)
    assert part.pattern.dof_count == int((~(held | part.clamped[:, None])).sum())
    unknowns = np.arange(1.0, part.pattern.dof_count + 1.0)
    nodal = part.pattern.nodal(unknowns)
    assert not nodal[part.clamped].any()
    np.testing.assert_array_equal(part.pattern.unknowns(nodal), unknowns)


def test_a_part_stands_for_the_whole() -> None:
    """The mirrored faces close to the whole's area, and nodal forces add up to the whole's."""
    mesh, part = quarter(ElementOrder.P1)
    whole = WholeSurface(mesh.symmetry, part.nodes)
    rest, faces = whole.at_nodes(part.nodes), whole.faces(part.faces)
    a, b, c = (rest[faces[:, k]] for k in range(3))
    vectors = 0.5 * np.cross(b - a, c - a)
    # The sides' area vectors cancel, the top's remains.
    np.testing.assert_allclose(vectors.sum(axis=0), [0.0, 0.0, X * Y], atol=1e-12)
    forces = np.random.default_rng(0).normal(size=part.nodes.shape)
    forces[mesh.symmetry.on_plane(part.nodes, X)] = 0.0
    total = mesh.symmetry.whole_force(forces.sum(axis=0))
    np.testing.assert_allclose(whole.nodal_forces(forces).sum(axis=0), total, atol=1e-9)


def test_flat_tetrahedra_are_refused() -> None:
    """One without volume is counted."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    with pytest.raises(ConfigError, match="1 tetrahedra of no positive volume"):
        discretise(
            oriented(TetMesh(vertices=vertices, tets=np.array([[0, 1, 2, 3]]), name="flat")),
            order=ElementOrder.P1,
        )


@pytest.mark.parametrize("order", list(ElementOrder))
def test_shape_functions_sum_to_one(order: ElementOrder) -> None:
    """Values sum to one, gradients to zero, weights to one."""
    element = reference_element(order)
    assert element.weights.sum() == pytest.approx(1.0)
    assert element.face_weights.sum() == pytest.approx(1.0)
    assert np.allclose(element.gradients.sum(axis=1), 0.0, atol=1e-14)
    assert np.allclose(element.face_values.sum(axis=1), 1.0)
    assert np.allclose(element.face_gradients.sum(axis=1), 0.0, atol=1e-14)


def test_quadratic_gradients_reproduce_a_quadratic() -> None:
    """The gradient of x^2 + y z is exact at the quadrature points."""
    element = reference_element(ElementOrder.P2)
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    nodes, tets = quadratic_nodes(corners, np.array([[0, 1, 2, 3]], dtype=np.int32))
    values = nodes[tets[0], 0] ** 2 + nodes[tets[0], 1] * nodes[tets[0], 2]
    near, far = 0.5854101966249685, 0.1381966011250105
    points = np.array([[far] * 3, [near, far, far], [far, near, far], [far, far, near]])
    expected = np.column_stack([2 * points[:, 0], points[:, 2], points[:, 1]])
    assert np.allclose(np.einsum("qni,n->qi", element.gradients, values), expected)


@pytest.mark.parametrize("many", [False, True])
def test_contact_rule_is_exact_to_degree_six(*, many: bool) -> None:
    """The mean of a^2 b^2 c^2 over a triangle is 2! 2! 2! 2! / 8!."""
    element = reference_element(ElementOrder.P1, many_points=many)
    product = (element.face_values**2).prod(axis=1)
    assert product @ element.face_weights == pytest.approx(16.0 / 40320.0, rel=1e-10)


def test_boundary_is_closed_and_looks_outwards() -> None:
    """Area vectors sum to zero, and x . n integrates to three times the volume."""
    grading = Grading(start_m=1e-3, end_m=1e-3, size_m=0.5e-3)
    whole = {"centre_m": (0.5e-3, 0.0), "symmetry": MirrorSymmetry()}
    mesh = revolved_mesh(PAD, grading, sector_count=12, name="box", **whole)
    for elements, nodes in (
        (mesh.tets, mesh.vertices),
        quadratic_nodes(mesh.vertices, mesh.tets)[::-1],
    ):
        faces, parents = boundary_faces(elements)
        a, b, c = (nodes[linear_facets(faces)[:, k]] for k in range(3))
        vectors = 0.5 * np.cross(b - a, c - a)
        assert np.allclose(vectors.sum(axis=0), 0.0, atol=1e-16)
        volume = np.sum(vectors * (a + b + c) / 3.0) / 3.0
        assert volume == pytest.approx(X * Y * Z, rel=1e-9)
        assert all(set(face) <= set(elements[p]) for face, p in zip(faces, parents, strict=True))
