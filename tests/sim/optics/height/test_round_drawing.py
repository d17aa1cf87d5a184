"""A round wall drawn from a polygonal mesh, and the solver's gap at the contact's edge."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sim.effects.plan import plan_effects
from sim.effects.scene_path import path_for
from sim.fields.press_fields import surface_state
from sim.fields.surface import SurfaceState
from sim.mesh.elements import linear_facets
from sim.optics.height.height_map import cut_face, cut_tables, height_maps
from sim.optics.height.node_kernel import indenter_height
from sim.scene.indenter import Cylinder
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.sensor.camera_geometry import CameraGeometry
from tacauchy_rig.core.arrays import FloatArray, IntArray
from tests.sim.optics.analytic_surface import camera

_DEPTH_M = 0.4e-3
_RADIUS_M = 2e-3
_PIXEL_M = 10e-6


@cache
def _punched() -> SurfaceState:
    """Press a cylinder into a disc, which leaves no direction out; 20 sectors."""
    scene = Scene(
        pad=DiscPad(radius_m=8e-3, height_m=4e-3),
        material=Material(young_pa=0.4e6, poisson=0.45),
        indenter=Cylinder(diameter_m=2.0 * _RADIUS_M, fillet_m=0.1e-3),
        target=Target(depth_m=_DEPTH_M),
        preset=Preset.BALANCED,
    )
    path = path_for(scene, plan_effects(scene))
    return surface_state(path, path.advance(_DEPTH_M))


def _camera(*, half_width_m: float, pixel_m: float = _PIXEL_M) -> CameraGeometry:
    count = round(2.0 * half_width_m / pixel_m) + 1
    return camera(count, count, pixel_m)


def _wall_radii(surface: SurfaceState) -> FloatArray:
    """Return how far from the axis the wall is as high as the fillet and a fifth, all around."""
    geometry = _camera(half_width_m=1.25 * _RADIUS_M)
    loaded = height_maps(surface, geometry).loaded
    level = loaded.min() + 0.12e-3
    radius = np.linspace(0.9, 1.2, 1201) * _RADIUS_M
    angle = np.radians(np.arange(0.0, 90.0, 0.9))
    column = (radius * np.cos(angle)[:, None]) / _PIXEL_M + geometry.centre_x_px
    row = (radius * np.sin(angle)[:, None]) / _PIXEL_M + geometry.centre_y_px
    i, j = row.astype(int), column.astype(int)
    v, u = row - i, column - j
    height = (1.0 - v) * ((1.0 - u) * loaded[i, j] + u * loaded[i, j + 1])
    height += v * ((1.0 - u) * loaded[i + 1, j] + u * loaded[i + 1, j + 1])
    return np.asarray(radius[np.argmax(height > level, axis=1)])


def test_the_wall_of_a_round_punch_is_round() -> None:
    """In all directions the wall lies within 0.5 um of a circle; a star without the rings."""
    radii = _wall_radii(_punched())
    assert np.ptp(radii) <= 1e-6
    star = _wall_radii(replace(_punched(), mesh_axis_m=None))
    assert np.ptp(star) > 6e-6
    assert radii.mean() < star.mean()


def test_no_pixel_of_a_press_lies_above_the_indenter() -> None:
    """The map stays below the body itself, not only below what bounds the gel."""
    surface = _punched()
    assert surface.standoff_m > 0.0
    geometry = _camera(half_width_m=7e-3, pixel_m=50e-6)
    loaded = height_maps(surface, geometry).loaded
    assert (loaded <= indenter_height(surface, *geometry.pad_grid())).all()


def test_depth_counts_from_where_the_gel_touches() -> None:
    """In the contact the map is as deep as the press, with no step of the solver's gap around."""
    maps = height_maps(_punched(), _camera(half_width_m=3e-3))
    assert maps.rest.max() - maps.loaded.min() == pytest.approx(_DEPTH_M, abs=0.2e-6)


def test_rings_that_are_round_already_stay() -> None:
    """A turned and carried smooth deformation is drawn where it is."""
    surface = _punched()
    radius = np.hypot(*surface.positions_rest[:, :2].T)
    angle = np.arctan2(surface.positions_rest[:, 1], surface.positions_rest[:, 0])
    smooth = surface.positions_rest.copy()
    smooth[:, 2] += 1e-4 * np.exp(-(radius**2) / (2e-3) ** 2) * np.cos(2.0 * angle)
    smooth[:, :2] += 1e-4 * np.exp(-(radius**2) / (4e-3) ** 2)[:, None] * (0.6, 0.8)
    shaped = replace(surface, positions=smooth, indenter_position=np.array([0.0, 0.0, 1.0]))
    geometry = _camera(half_width_m=2.4e-3, pixel_m=50e-6)
    drawn = height_maps(shaped, geometry).loaded
    as_is = height_maps(replace(shaped, mesh_axis_m=None), geometry).loaded
    # The arc's height over a chord of 18 degrees is 1.2 % of the radius, the slope up to 0.05.
    assert np.abs(drawn - as_is).max() < 2e-6


def test_cut_faces_keep_the_surface() -> None:
    """The parts of faces cover what the faces covered, and neighbours share the nodes on edges."""
    surface = _punched()
    faces = surface.faces
    cut = cut_tables(faces, len(surface.positions))
    added, places = cut["parts"][len(faces) :], cut_face()[2]
    at = surface.positions[faces]
    bends = 0.125 * (at[:, :3] + np.roll(at[:, :3], -1, axis=1) - 2.0 * at[:, 3:])
    at_border = np.where(cut["across"][..., None] < 0, bends, 0.0)
    on_faces = cut["values"] @ at + cut["straight"] @ at_border
    nodes = np.concatenate([surface.positions, on_faces[cut["face"], cut["place"]]])
    parts = added.reshape(len(faces), -1)
    np.testing.assert_allclose(nodes[parts], on_faces[:, places.reshape(-1)], atol=1e-17)
    assert np.abs(bends).max() > 1e-6
    assert _area(nodes, added) == pytest.approx(_area(surface.positions, faces), rel=1e-9)


def _area(nodes: FloatArray, faces: IntArray) -> float:
    """Return the area of the linear facets seen from above [m^2]."""
    a, b, c = (nodes[linear_facets(faces)[:, k], :2] for k in range(3))
    first, second = b - a, c - a
    return float(0.5 * np.sum(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]))
