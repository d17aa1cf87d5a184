"""What a wide barrier hands over to the optics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.fields.press_fields import surface_state
from sim.optics.height.height_map import height_maps
from sim.press_command import scene_from
from sim.scene.indenter import (
    Cylinder,
    Indenter,
    Plane,
    Sphere,
    cylinder_triangles,
    grown,
    mesh_indenter,
)
from sim.sensor.camera_geometry import CameraGeometry

_DEPTH_M = 0.4e-3
_SCENE = scene_from(
    "--pad disc:radius=8mm,height=4mm --young 0.4MPa --poisson 0.45 "
    "--indenter cylinder:diameter=4mm,fillet=0.3mm --depth 0.4mm --preset fast"
)
_PIXEL_M = 50e-6
_GEOMETRY = CameraGeometry(
    width=121,
    height=121,
    scale_x_m=_PIXEL_M,
    scale_y_m=_PIXEL_M,
    centre_x_px=60.0,
    centre_y_px=60.0,
)


@pytest.mark.parametrize(
    "indenter", [_SCENE.indenter, Sphere(diameter_m=10e-3), Cylinder(diameter_m=4e-3)]
)
def test_the_gel_lies_on_the_indenter_in_the_contact(indenter: Indenter) -> None:
    """It is as deep as the press, and touches as far as its contact points do."""
    scene = replace(_SCENE, indenter=indenter)
    path = path_for(scene, plan_effects(scene))
    assert path.model.contact_options.is_wide
    point = path.advance(_DEPTH_M)
    maps = height_maps(surface_state(path, point), _GEOMETRY)
    assert maps.rest.max() - maps.loaded.min() == pytest.approx(_DEPTH_M, abs=5e-6)
    radius = np.sqrt(maps.contact.sum() / np.pi) * _PIXEL_M
    assert radius == pytest.approx(point.contact_radius_m, abs=0.2e-3)


def test_a_grown_body_is_as_far_from_the_body_everywhere() -> None:
    """Along the outward normal of its underside; a plate is its own, only lower."""
    body, by = Cylinder(diameter_m=4e-3, fillet_m=0.3e-3), 40e-6
    angle = np.linspace(0.0, 0.4 * np.pi, 9)
    x = 1.7e-3 + (0.3e-3 + by) * np.sin(angle)
    below = grown(body, by).lower_surface(x, np.zeros(9)) - by
    np.testing.assert_allclose(below, 0.3e-3 - (0.3e-3 + by) * np.cos(angle), atol=1e-12)
    assert grown(Sphere(diameter_m=2e-3), by) == Sphere(diameter_m=2e-3 + 2.0 * by)
    assert grown(Plane(), by) == Plane()
    facets = mesh_indenter(*cylinder_triangles(body, sectors=128), name="punch")
    x = np.linspace(0.0, 1.9e-3, 20)
    np.testing.assert_allclose(
        grown(facets, by).lower_surface(x, np.zeros(20)),
        grown(body, by).lower_surface(x, np.zeros(20)),
        atol=2e-6,  # the facets' own
    )
    sharp = mesh_indenter(*cylinder_triangles(Cylinder(diameter_m=4e-3)), name="sharp")
    assert np.ptp(grown(sharp, by).lower_surface(np.array([0.0, 2.03e-3]), np.zeros(2))) < 1e-9


def test_a_narrow_barrier_leaves_the_body_as_it_is() -> None:
    """A micrometre is within what counts as touching; growing by it would widen the contact."""
    scene = replace(_SCENE, barrier_m=1e-6)
    path = path_for(scene, plan_effects(scene))
    assert not path.model.contact_options.is_wide
    assert surface_state(path, path.advance(0.05e-3)).indenter == scene.indenter
