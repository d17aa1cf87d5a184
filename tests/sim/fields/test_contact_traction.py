"""Pressure and shear recovered from the contact: exact where they are polynomials, and round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.presets import build_model, mesh_for
from sim.fields.contact_traction import SurfaceTraction, surface_traction
from sim.fields.press_fields import trial_fields
from sim.scene.scene import Scene
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.solve.path_point import PathPoint
from tacauchy_rig.core.arrays import FloatArray


def test_a_quadratic_pressure_is_recovered_exactly_inside_the_contact(
    pressed: tuple[LoadingPath, PathPoint],
) -> None:
    """Whatever the mesh: the fit is of the element's order."""
    path, point = pressed
    model = path.model
    contact = point.equilibrium.contact
    areas = np.linalg.norm(model.surface.area_vectors(point.state.positions), axis=2)

    def wanted(x: FloatArray) -> FloatArray:
        return np.asarray(1e4 + 3e9 * x[..., 0] ** 2 + 1e9 * x[..., 1] ** 2)

    touched = np.any(contact.forces != 0.0, axis=2)
    away = np.hypot(contact.points[..., 0], contact.points[..., 1])
    flat = np.zeros_like(contact.forces)
    flat[..., 2] = np.where(touched, areas * wanted(contact.points), 0.0)
    stated = replace(contact, forces=flat)
    equilibrium = replace(point.equilibrium, touch=lambda: stated)
    found = surface_traction(model, replace(point, equilibrium=equilibrium))
    places = point.state.positions
    inner = np.hypot(places[:, 0], places[:, 1]) < 0.4 * away[touched].max()
    chosen = np.intersect1d(np.flatnonzero(inner), np.unique(model.faces))
    # The gel is curved: in a node's tangent plane the pressure is quadratic but for its slope's.
    np.testing.assert_allclose(found.pressure_pa[chosen], wanted(places[chosen]), rtol=2e-3)
    assert len(chosen) > 10


def test_a_quarter_gives_what_the_whole_gives(
    ball: Scene, pressed: tuple[LoadingPath, PathPoint]
) -> None:
    """On the mirror planes too, where half of a node's patch is an image."""
    part, point = pressed
    whole = LoadingPath(build_model(ball, mesh=mesh_for(ball, symmetric=False)), ball.indenter)

    def by_place(model: Model, found: SurfaceTraction) -> dict[tuple[float, ...], float]:
        nodes = np.unique(model.faces)
        rest = np.round(model.nodes[nodes] * 1e9) + 0.0
        return dict(zip(map(tuple, rest), found.pressure_pa[nodes], strict=True))

    quarter = by_place(part.model, surface_traction(part.model, point))
    full = by_place(whole.model, surface_traction(whole.model, whole.advance(0.2e-3)))
    largest = max(full.values())
    for place, pressure in quarter.items():
        assert pressure == pytest.approx(full[place], abs=2e-4 * largest)


def test_nodal_forces_are_split_along_the_surface(pressed: tuple[LoadingPath, PathPoint]) -> None:
    """Both parts add up, and without friction next to nothing lies along the surface."""
    _, point = pressed
    found = trial_fields(*pressed).at_nodes
    force, normal, tangential = (
        found[f"contact_{part}force_n"] for part in ("", "normal_", "tangential_")
    )
    np.testing.assert_allclose(normal + tangential, force, atol=1e-15)
    assert np.abs(tangential).sum() < 0.05 * np.abs(normal).sum()
    assert np.abs(found["contact_shear_pa"]).max() < 1e-9 * found["contact_pressure_pa"].max()
    np.testing.assert_allclose(force.sum(axis=0), -point.force_n, atol=1e-9)
