"""The measurements behind the numbers, on scenes small enough for a test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.force_error_estimate import CoarserForce
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import Material
from sim.scene.pad import DiscPad
from sim.scene.scene import Preset, Scene, Target
from sim.studies.verification.against_itself import held_out
from sim.studies.verification.against_itself.balance import balanced_press
from sim.studies.verification.against_itself.barrier import BarrierLimit, barrier_limit
from sim.studies.verification.against_itself.refined_press import (
    NamedScene,
    RefinedPress,
    refined_press,
)
from sim.studies.verification.against_itself.shifts import shifted_press
from sim.studies.verification.orders import fitted_order
from sim.studies.verification.rim_order import rim_forces
from sim.studies.verification.scenes import HELD_OUT, TRAINING

SCENE = Scene(
    pad=DiscPad(radius_m=5e-3, height_m=3e-3),
    material=Material(young_pa=3e5, poisson=0.46),
    indenter=Sphere(diameter_m=5e-3),
    target=Target(depth_m=0.05e-3),
    preset=Preset.FAST,
)


@pytest.mark.parametrize("order", [1.0, 1.8, 3.0])
def test_fit_finds_the_order_and_the_limit(order: float) -> None:
    """Forces on a power law give its power back."""
    edges = np.array([2.0, 1.333, 1.0, 0.667, 0.5])
    found, limit = fitted_order(edges, 1.2 + 0.05 * edges**order)
    assert found == pytest.approx(order, abs=0.02)
    assert limit == pytest.approx(1.2, rel=2e-3)


def test_finer_edges_at_a_sharp_rim_lower_the_force() -> None:
    """By less every time; a whole punch's force comes from its quarter."""
    coarse, middle, fine = rim_forces((0.32, 0.16, 0.08))
    assert coarse > middle > fine > 0.5
    assert coarse - middle > middle - fine


def test_ten_scenes_are_held_out() -> None:
    """None of them made up the estimate, and no two are alike."""
    scenes = [named.scene for named in HELD_OUT]
    assert len(scenes) == 10
    assert all(a != b for k, a in enumerate(scenes) for b in scenes[:k])
    assert not any(named.scene in scenes for named in TRAINING)


def test_small_scene_has_an_estimate_and_a_true_error() -> None:
    """Four meshes of one ball: forces come down as edges shorten, and the estimate holds."""
    found = refined_press(NamedScene(name="ball", scene=SCENE), finer=1.5)
    assert found.coarser[1].force_n > found.force_n > 0.99 * found.finer_n
    assert found.is_inside


def press_with(*, finer_n: float) -> RefinedPress:
    """Return a press that was never made."""
    coarser = (CoarserForce(ratio=1.5, force_n=1.01), CoarserForce(ratio=2.0, force_n=1.03))
    named = NamedScene(name="made up", scene=SCENE)
    return RefinedPress(named=named, force_n=1.0, finer_n=finer_n, coarser=coarser)


@pytest.mark.parametrize(("outside", "passed"), [(0, True), (1, True), (2, False)])
def test_nine_of_ten_must_lie_inside(outside: int, passed: bool) -> None:
    """Two that lie outside fail the section."""
    found = [press_with(finer_n=0.5 if k < outside else 0.999) for k in range(10)]
    section = held_out.section(found)
    assert section.passed is passed
    assert [row[-1] for row in section.rows].count("no") == outside


def test_parabola_through_three_distances() -> None:
    """Forces a + b d + c d^2 have the limit a."""
    forces = tuple(2.0 + 0.3 * d + 0.1 * d**2 for d in (1.0, 0.5, 0.25))
    limit = BarrierLimit(
        indenter="", contact="", distance_m=1e-6, forces_n=(forces[0], forces[1], forces[2])
    )
    assert limit.limit_n == pytest.approx(2.0)
    assert limit.difference == pytest.approx(0.2)


def test_contact_distance_hardly_matters() -> None:
    """F_z of a small press is within 0.3 % of its limit."""
    assert barrier_limit(SCENE).difference < 3e-3


def test_forces_agree_and_stress_follows() -> None:
    """Base, load and indenter agree to 1e-6; the surface's stress carries the force roughly."""
    scene = replace(SCENE, target=Target(force_n=0.01))
    found = balanced_press(NamedScene(name="ball", scene=scene))
    assert found.is_balanced
    assert 0.0 < max(found.traction_gaps) < 0.1


def test_shifted_press_moves_by_half_an_edge() -> None:
    """A ball half an element aside on the same mesh is felt a little, not a lot."""
    found = shifted_press(replace(SCENE, preset=Preset.FAST))
    assert 0.0 < found.change < 0.05


@pytest.mark.slow
def test_sharp_rim_shifted() -> None:
    """A sharp punch cuts other faces when it is moved; F_z stays within 6 % on preset fast."""
    found = shifted_press(replace(SCENE, indenter=Cylinder(diameter_m=3e-3)))
    assert 0.0 < found.change < 0.06
