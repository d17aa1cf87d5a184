"""A pad as its element type sees it: what is held, what may be touched, and how much there is."""

from __future__ import annotations

import numpy as np
import pytest

from sim.mesh.discretisation import Discretisation, discretise
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved import Grading, revolved_mesh
from sim.mesh.symmetry import WholeSurface
from sim.mesh.tet_mesh import TetMesh, oriented
from sim.scene.pad import BoxPad
from tacauchy_rig.core.errors import ConfigError

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
