"""Turned indenters: their undersides seen from above."""

from __future__ import annotations

import numpy as np
import pytest

from sim.scene.indenter import (
    Cylinder,
    Indenter,
    Plane,
    Sphere,
    TurnedIndenter,
    cylinder_triangles,
    tilted,
)
from sim.scene.triangle_surface import closed_surface

PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.4e-3)


@pytest.mark.parametrize("indenter", [PUNCH, Cylinder(diameter_m=4e-3)])
def test_a_cylinder_of_triangles_is_closed_and_has_its_volume(indenter: Cylinder) -> None:
    """Outward triangles around pi r^2 l, less what the fillet and the polygon take off."""
    vertices, faces = cylinder_triangles(indenter)
    surface = closed_surface(vertices, faces, name="cylinder")
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0
    full = np.pi * indenter.radius_m**2 * 2.0 * indenter.diameter_m
    assert 0.985 * full < volume < full


@pytest.mark.parametrize("indenter", [PUNCH, Sphere(diameter_m=6e-3), Plane()])
def test_an_upright_body_is_the_body_itself(indenter: Indenter) -> None:
    """No rotation changes nothing, and a tiny one next to nothing."""
    x, y = np.meshgrid(np.linspace(-1.5e-3, 1.5e-3, 9), np.linspace(-1.5e-3, 1.5e-3, 9))
    rest = indenter.lower_surface(x, y)
    upright = TurnedIndenter(indenter=indenter, rotation=np.eye(3))
    np.testing.assert_array_equal(upright.lower_surface(x, y), rest)
    leaning = TurnedIndenter(indenter=indenter, rotation=tilted(1e-6, 0.0))
    # Of triangles, a fillet of 0.4 mm is off by its chords: 0.4 mm (1 - cos(pi / 32)) = 2 um.
    np.testing.assert_allclose(leaning.lower_surface(x, y), rest, atol=2.2e-6)


def test_a_tilted_flat_end_rises_as_its_plane() -> None:
    """About y by an angle: the end falls along +x by its tangent."""
    angle = np.radians(5.0)
    turned = TurnedIndenter(indenter=PUNCH, rotation=tilted(0.0, angle))
    x = np.linspace(-1e-3, 1e-3, 5)
    expected = -np.tan(angle) * x
    np.testing.assert_allclose(turned.lower_surface(x, np.zeros(5)), expected, atol=1e-9)
    low, high = turned.reach()
    assert np.all(low < -PUNCH.radius_m * np.cos(angle) + 1e-4)
    assert np.all(high > PUNCH.radius_m * np.cos(angle) - 1e-4)
