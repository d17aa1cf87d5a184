"""Presses, also with a wide barrier."""

from dataclasses import replace

import numpy as np
import pytest

from sim.contact.surface_and_grip import ContactOptions
from sim.effects.effect_choice import plan_effects
from sim.effects.press_with_effects import path_for
from sim.fields.saved_press import surface_state
from sim.fields.stress import SurfaceStress, surface_stress
from sim.material.laws.law_and_lame import law
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.optics.height.height_map import height_maps
from sim.press import press
from sim.press_arguments import scene_from
from sim.scene.indenter import (
    Cylinder,
    Indenter,
    Plane,
    Sphere,
    cylinder_triangles,
    grown,
    mesh_indenter,
)
from sim.scene.material import LawName, Material
from sim.scene.pad import BoxPad
from sim.scene.scene import ContactMode, Preset, Scene, Target
from sim.sensor.camera_geometry import CameraGeometry
from sim.solve.equilibrium import SolverOptions
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from tacauchy_rig.core.errors import ConfigError, ConvergenceError

PAD = BoxPad(
    size_x_m=20e-3, size_y_m=24e-3, height_m=4e-3, dome_radius_x_m=0.1, dome_radius_y_m=0.2
)
PUNCH = Cylinder(diameter_m=5e-3, fillet_m=0.2e-3)
SCENE = Scene(
    pad=PAD,
    material=Material(young_pa=4e5, poisson=0.48),
    indenter=PUNCH,
    target=Target(depth_m=0.15e-3),
    preset=Preset.FAST,
)


def small_model(*, centre_m: tuple[float, float] = (0.0, 0.0)) -> Model:
    """Return a coarse domed pad, or what of it the planes through the axis leave."""
    mesh = revolved_mesh(
        PAD,
        Grading(start_m=2.3e-3, end_m=2.5e-3, size_m=0.4e-3, growth=2.0),
        centre_m=centre_m,
        sector_count=8,
        name="test",
    )
    return Model(
        mesh,
        order=ElementOrder.P2,
        law=law(LawName.STABLE_NEO_HOOKEAN),
        young_pa=4e5,
        poisson=0.48,
        contact_options=ContactOptions(distance_m=2e-6),
    )


# Preset fast stops where what is unbalanced along z is 1e-6 of the modelled part's contact force,
# and a quarter's leans: it is up to 0.6 % larger than its z under this ball.
BALANCE = 1.01e-6


@pytest.mark.parametrize("indenter", [PUNCH, Sphere(diameter_m=8e-3)])
@pytest.mark.parametrize("contact", list(ContactMode))
def test_press_balances_and_never_overlaps(indenter: Indenter, contact: ContactMode) -> None:
    """Indenter force and base reaction agree to 1e-6, every gap is positive."""
    result = press(replace(SCENE, indenter=indenter, contact=contact))
    assert result.force_n[2] > 0.1
    assert result.force_balance_relative < BALANCE
    assert 0.0 < result.gap_min_m < SCENE.contact_distance_m
    assert result.base_reaction_n[2] == pytest.approx(-result.force_n[2], rel=BALANCE)
    assert result.min_jacobian > 0.3
    assert np.hypot(*result.force_n[:2]) < 1e-9 * result.force_n[2]
    assert 0.2e-3 < result.contact_radius_m < 2.6e-3
    assert result.max_pressure_pa > result.force_n[2] / result.contact_area_m2


def test_stiffness_is_the_slope_of_the_force() -> None:
    """The tangent's dF/d(depth) agrees with a difference."""
    path = LoadingPath(small_model(), PUNCH)
    first = path.advance(0.150e-3)
    second = path.advance(0.151e-3)
    slope = (second.force_n[2] - first.force_n[2]) / 1e-6
    assert first.stiffness_n_m == pytest.approx(slope, rel=0.02)


def test_off_centre_press_balances_without_symmetry() -> None:
    """A press to the side of a dome is solved on the whole pad, and its moment is not zero."""
    model = small_model(centre_m=(1.5e-3, 1.0e-3))
    assert model.mesh.symmetry.copies == 1
    # Stopped at a residual of 1e-8: at preset fast's 1e-6 it is 7.3e-7 along all axes together,
    # and the rule bounds but that along z.
    closely = replace(SCENE, centre_m=(1.5e-3, 1.0e-3), preset=Preset.BALANCED)
    result = press(closely, model=model)
    assert result.force_balance_relative < 1e-6
    assert result.force_n[2] > 0.1
    assert abs(result.moment_nm[0]) > 0.0


def test_failed_press_names_how_far_it_got() -> None:
    """Newton cut short at some depth: the message has the last good depth and force."""
    path = LoadingPath(small_model(), PUNCH)
    path.advance(0.05e-3)
    path.options = SolverOptions(iteration_max=0)
    with pytest.raises(ConvergenceError, match=r"stopped at 0\.05\d* mm and 0\.\d+ N on the way"):
        path.advance(0.0505e-3)


def test_a_motion_across_a_mirror_plane_is_refused() -> None:
    """A part of the pad cannot tell what the whole would do."""
    path = LoadingPath(small_model(centre_m=(0.0, 1e-3)), PUNCH)
    path.advance(0.02e-3)
    assert path.carry(shift_m=(0.0, 1e-5)).force_n[2] > 0.0
    for motion in ({"shift_m": (1e-5, 0.0)}, {"twist_rad": 0.01}):
        with pytest.raises(ConfigError, match="not mirrored"):
            path.carry(**motion)  # type: ignore[arg-type]


@pytest.mark.parametrize("indenter", [PUNCH, Sphere(diameter_m=5e-3)])
def test_indenter_beside_the_pad_is_refused(indenter: Indenter) -> None:
    """The message says where the tip stands, the remedy where the pad ends."""
    with pytest.raises(ConfigError, match=r"x = 13 mm, y = 0 mm comes down beside") as caught:
        press(replace(SCENE, indenter=indenter, centre_m=(13e-3, 0.0)))
    assert "from -10 to 10 mm in x" in caught.value.remedy


def test_scene_refuses_nonsense() -> None:
    """Two targets, none, or a material that does not exist."""
    with pytest.raises(ConfigError, match="either a depth or a force"):
        Target(depth_m=1e-3, force_n=1.0)
    with pytest.raises(ConfigError, match="either a depth or a force"):
        Target()
    with pytest.raises(ConfigError, match="Poisson"):
        Material(young_pa=1e5, poisson=0.5)
    with pytest.raises(ConfigError, match="Young"):
        Material(young_pa=0.0, poisson=0.4)
    with pytest.raises(ConfigError, match="fillet"):
        Cylinder(diameter_m=5e-3, fillet_m=3e-3)


def test_json_has_every_number_that_was_promised() -> None:
    """The keys of ``press --json``."""
    keys = set(press(SCENE).as_json())
    promised = (
        "force_n moment_nm depth_m contact_area_m2 contact_radius_m max_pressure_pa "
        "base_reaction_n force_balance_relative surface_traction_gap_relative "
        "algorithms_apart_relative min_jacobian gap_min_m newton_iterations wall_s element "
        "node_count tet_count estimated_force_error_relative estimated_force_error_basis"
    )
    assert set(promised.split()) <= keys


def test_one_face_at_a_rim_refuses_no_press(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its stress may be as large as the field's in the L2 norm; what is told stays well defined."""

    def torn(model: Model, positions: np.ndarray) -> SurfaceStress:
        found = surface_stress(model, positions)
        pressed = np.flatnonzero(found.normal_pa < 0.1 * found.normal_pa.min())
        found.traction_pa[pressed[np.argmin(found.areas_m2[pressed])]] *= 8.0
        return found

    monkeypatch.setattr("sim.press.surface_stress", torn)
    found = press(SCENE).as_json()
    assert 0.1 < found["surface_traction_gap_relative"] < found["algorithms_apart_relative"] < 0.5


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
