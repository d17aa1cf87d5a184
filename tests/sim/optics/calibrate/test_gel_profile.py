"""Gel profiles from simulated presses, and slopes of an unloaded dome."""

from dataclasses import replace

import numpy as np
import pytest

from sim.optics.calibrate.gel_profile import (
    PressedProfiles,
    RadialProfile,
    pad_slopes,
    radial_profile,
    rest_slopes,
    touching_places,
)
from sim.optics.height.height_map import height_maps
from sim.scene.indenter import Sphere
from sim.scene.pad import BoxPad
from tacauchy_rig.core.errors import ConfigError
from tests.sim.optics.analytic_surface import (
    APEX_M,
    ExponentialSkirt,
    ball_press,
    camera,
    pressed_surface,
)

BALL_M = 2.35e-3


def test_radial_profile_of_a_pressed_ball() -> None:
    """Contact radius, tilt under the ball and depth come out of the height maps."""
    tip = APEX_M - 8e-4
    surface = pressed_surface(
        lambda x, y: ball_press(x, y, ball_radius_m=BALL_M, contact_radius_m=1.2e-3, tip_z_m=tip),
        indenter=Sphere(diameter_m=2 * BALL_M),
        tip=(0.0, 0.0, tip),
        edge_m=2e-4,
    )
    fine = camera(400, 400, 2e-5)
    maps = height_maps(surface, fine, contact_gap_m=1e-6)
    contact_radius, profile = radial_profile(maps, surface, fine, ball_radius_m=BALL_M)
    sunk = radial_profile(maps, surface, fine, ball_radius_m=5e-4)[0]  # by its area
    assert [contact_radius, sunk] == pytest.approx([1.2e-3] * 2, rel=0.05)
    under = profile.radius_m < 1.1e-3
    np.testing.assert_allclose(profile.tilt[under], profile.radius_m[under] / BALL_M, atol=0.01)
    assert profile.indentation_m[0] == pytest.approx(8e-4, rel=0.01)
    assert 0.0 < profile.indentation_m[-1] < 1e-4
    np.testing.assert_array_equal(profile.outward_m, 0.0)
    wider = replace(surface, positions=surface.positions * (1.02, 1.02, 1.0))
    outward = radial_profile(maps, wider, fine, ball_radius_m=BALL_M)[1].outward_m
    np.testing.assert_allclose(outward, profile.radius_m * (1.0 - 1.0 / 1.02), atol=1e-6)


@pytest.mark.parametrize("contact_radius", [0.7e-3, 1.0e-3, 1.25e-3, 1.6e-3])
def test_pressed_profiles_interpolate_between_presses(contact_radius: float) -> None:
    """Between and just beyond the presses the ball stays a ball and the skirt stays close."""
    exact = ExponentialSkirt(ball_radius_m=BALL_M, decay_m=1e-3)
    profiles = PressedProfiles([(a, exact(a)) for a in (1.5e-3, 0.8e-3, 1.1e-3)])
    found, expected = profiles(contact_radius), exact(contact_radius)
    under = found.radius_m < 0.98 * contact_radius
    np.testing.assert_allclose(found.tilt[under], found.radius_m[under] / BALL_M, atol=2e-3)
    skirt = np.interp(found.radius_m, expected.radius_m, expected.tilt, right=0.0)
    assert np.abs(found.tilt - skirt).max() < 0.05


def test_motion_beyond_a_profile_decays_without_a_step() -> None:
    """Two presses that end at unlike distances, in radii of their contact, agree beyond both."""
    radius = np.linspace(0.0, 4e-3, 81)
    still = np.zeros_like(radius)
    presses = []
    for a in (1e-3, 1.5e-3):  # of one press, scaled
        outward = 10.0 * a**3 * radius / np.maximum(radius, 1.2 * a) ** 2
        profile = RadialProfile(radius_m=radius, tilt=still, indentation_m=still, outward_m=outward)
        presses.append((a, profile))
    found, at = PressedProfiles(presses)(1.2e-3), np.linspace(1e-3, 7e-3, 30)
    wanted = 10.0 * 1.2e-3**3 * at / np.maximum(at, 1.44e-3) ** 2
    np.testing.assert_allclose(found.outward(at), wanted, rtol=0.02)


def test_profiles_without_contact_are_refused() -> None:
    """A press that does not touch cannot give a profile."""
    zero = np.zeros(2)
    nothing = RadialProfile(
        radius_m=np.array([0.0, 1.0]), tilt=zero, indentation_m=zero, outward_m=zero
    )
    with pytest.raises(ConfigError, match="1 simulated presses give no gel profile"):
        PressedProfiles([(0.0, nothing)])
    with pytest.raises(ConfigError, match="0 simulated presses"):
        PressedProfiles([])


PAD = BoxPad(
    size_x_m=25e-3, size_y_m=20e-3, height_m=4e-3, dome_radius_x_m=0.185, dome_radius_y_m=0.105
)


def test_slopes_of_a_dome() -> None:
    """The top falls off by x over the radius along x, y over the other along y."""
    places = np.array([[3e-3, 0.0], [0.0, -5e-3], [2e-3, 4e-3]])
    np.testing.assert_allclose(pad_slopes(PAD, places), -places / (0.185, 0.105), rtol=1e-6)


def test_slopes_follow_the_image() -> None:
    """A camera turned by a quarter sees the slope along y along its columns."""
    turned = replace(camera(), rotation_rad=np.pi / 2)
    x, y = turned.pad_grid()
    columns, rows = rest_slopes(PAD, turned)
    np.testing.assert_allclose(columns, -y / 0.105, atol=1e-9)
    np.testing.assert_allclose(rows, x / 0.185, atol=1e-9)


def test_a_ball_touches_where_slopes_agree() -> None:
    """There the ball's lower side is as steep as the gel; on flat gel it is under the axis."""
    axes = np.array([[6e-3, -4e-3], [0.0, 0.0]])
    touched = touching_places(axes, PAD, ball_radius_m=2.35e-3)
    np.testing.assert_allclose((touched - axes) / 2.35e-3, pad_slopes(PAD, touched), atol=1e-8)
    assert np.all(np.abs(touched[0]) < np.abs(axes[0]))
    flat = replace(PAD, dome_radius_x_m=np.inf, dome_radius_y_m=np.inf)
    np.testing.assert_array_equal(touching_places(axes, flat, ball_radius_m=2.35e-3), axes)
