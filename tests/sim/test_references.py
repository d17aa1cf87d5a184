"""Forces against solutions that other people or other programs found."""

from __future__ import annotations

import numpy as np
import pytest

from sim.press import press
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import LawName, Material
from sim.scene.pad import DiscPad
from sim.scene.scene import ContactMode, Preset, Scene, Target

DISC = DiscPad(radius_m=12e-3, height_m=4.5e-3)
PUNCH = Cylinder(diameter_m=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("poisson", "kappa"), [(0.45, 1.930), (0.499, 2.081)])
def test_flat_punch_on_a_bonded_layer(poisson: float, kappa: float) -> None:
    """F = 2 a E d kappa / (1 - nu^2), Hayes et al. 1972, a / h = 0.5556, on a wide disc."""
    young, depth = 3e5, 20e-6
    scene = Scene(
        pad=DiscPad(radius_m=40e-3, height_m=4.5e-3),
        material=Material(young_pa=young, poisson=poisson, law=LawName.LINEAR),
        indenter=PUNCH,
        target=Target(depth_m=depth),
        preset=Preset.BALANCED,
        barrier_m=1e-7,
    )
    expected = 2.0 * 2.5e-3 * young * depth * kappa / (1.0 - poisson**2)
    assert press(scene).force_n[2] == pytest.approx(expected, rel=0.035)


@pytest.mark.parametrize(
    ("name", "depth_mm", "force_n"),
    [
        pytest.param(LawName.NEO_HOOKEAN, 0.2, 0.73314, marks=pytest.mark.slow),
        pytest.param(LawName.NEO_HOOKEAN, 0.5, 1.89035, marks=pytest.mark.slow),
        (LawName.STABLE_NEO_HOOKEAN, 0.2, 0.72494),
        pytest.param(LawName.STABLE_NEO_HOOKEAN, 0.5, 1.83785, marks=pytest.mark.slow),
    ],
)
def test_bonded_disc_press_at_finite_strain(name: LawName, depth_mm: float, force_n: float) -> None:
    """Axisymmetric finite-strain solution, felupe 11.3 extrapolated over three meshes."""
    scene = Scene(
        pad=DISC,
        material=Material(young_pa=3e5, poisson=0.45, law=name),
        indenter=PUNCH,
        target=Target(depth_m=depth_mm * 1e-3),
        contact=ContactMode.BONDED,
        preset=Preset.BALANCED,
    )
    assert press(scene).force_n[2] == pytest.approx(force_n, rel=0.03)


def test_small_sphere_on_a_thick_pad_follows_hertz() -> None:
    """F = 4/3 E* sqrt(R) d^1.5 where the contact is small against the pad."""
    young, poisson, radius, depth = 3e5, 0.4, 2e-3, 40e-6
    scene = Scene(
        pad=DiscPad(radius_m=12e-3, height_m=10e-3),
        material=Material(young_pa=young, poisson=poisson, law=LawName.LINEAR),
        indenter=Sphere(diameter_m=2.0 * radius),
        target=Target(depth_m=depth),
        preset=Preset.BALANCED,
        barrier_m=1e-7,
    )
    expected = 4.0 / 3.0 * young / (1.0 - poisson**2) * np.sqrt(radius) * depth**1.5
    result = press(scene)
    assert result.force_n[2] == pytest.approx(expected, rel=0.05)
    assert result.contact_radius_m == pytest.approx(np.sqrt(radius * depth), rel=0.1)
