"""Contact modes: their signatures, sections and figures."""

from pathlib import Path

import numpy as np
import pytest

from sim.effects.effect_choice import plan_effects
from sim.effects.presets import mesh_for
from sim.effects.press_with_effects import path_for
from sim.material.laws.law_and_lame import law
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder, Sphere
from sim.scene.material import LawName, Layer, Material
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import ContactMode, Effect, Motion, Preset, Scene, Target
from sim.sensor.sensor import load_sensor
from sim.solve.equilibrium import SolverOptions
from sim.solve.model import Model
from sim.studies.modes.contact_signature import surface_maps, traction_arrows
from sim.studies.modes.runs import (
    FRICTION,
    ModeRun,
    press_mode,
    slide_criteria,
    slide_mode,
    twist_mode,
)
from sim.studies.modes.study import modes_figure, section, sensors_figure

BALL = Sphere(diameter_m=10e-3)
DEPTH_M = 0.3e-3


@pytest.fixture(scope="module")
def runs() -> dict[str, ModeRun]:
    """A ball pressed into a small whole pad, then slid, then turned instead."""
    scene = Scene(
        pad=DiscPad(radius_m=8e-3, height_m=4e-3),
        material=Material(young_pa=4e5, poisson=0.48),
        indenter=BALL,
        target=Target(depth_m=DEPTH_M),
        preset=Preset.FAST,
        contact=ContactMode.FRICTION,
        friction=FRICTION,
        motion=Motion(shift_m=(1e-3, 0.0)),
        effects=((Effect.SYMMETRY, False),),
    )
    path = path_for(scene, plan_effects(scene))
    # Preset fast's 1e-6 of the contact force leaves parts along the surface that add up to more.
    path.options = SolverOptions(residual_relative=1e-7)
    pressed = press_mode(load_sensor("gelsight-mini"), BALL, path, path.advance(DEPTH_M))
    return {mode.name: mode for mode in (pressed, slide_mode(pressed), twist_mode(pressed))}


def test_pressing_pulls_radially_and_sums_to_nothing(runs: dict[str, ModeRun]) -> None:
    """Tangential forces of a straight press run to and from the axis and cancel."""
    signature = runs["press"].signature
    assert runs["press"].passed, runs["press"].criteria
    assert signature.radial_share > signature.radial_share_points
    assert np.linalg.norm(signature.tangential_n[:2]) < 1e-3 * signature.normal_size_n


def test_sliding_opposes_the_motion_with_mu_times_the_normal_force(
    runs: dict[str, ModeRun],
) -> None:
    """Under a held force, along x: the resultant, and the pressure that moves forward."""
    slide = runs["slide"]
    assert slide.passed, slide.criteria
    assert all(criterion.judged for criterion in slide.criteria)
    assert slide.signature.sliding_friction == pytest.approx(FRICTION, rel=1.5e-3)
    assert slide.signature.centre_m[0] > 1e-5
    assert slide.point.force_n[2] == pytest.approx(runs["press"].point.force_n[2], rel=1e-6)


def test_a_slide_that_still_grips_is_not_judged(runs: dict[str, ModeRun]) -> None:
    """While the drag grows, mu F_n is neither met nor missed, and the run has not passed."""
    before, after = runs["press"].signature, runs["slide"].signature
    judged = [criterion.judged for criterion in slide_criteria(before, after, 0.1)]
    assert judged == [True, True, False, True]
    assert [c.passed for c in slide_criteria(before, after, 0.1)] == [True, False, False, True]


def test_torsion_pulls_around_the_axis(runs: dict[str, ModeRun]) -> None:
    """A turn that starts where the press ended, not where the slide did.

    What it drags sideways is nothing, to a tenth of what equilibria in passing are even to.
    """
    twist = runs["twist"]
    assert twist.passed, twist.criteria
    assert np.linalg.norm(twist.point.force_n[:2]) < 1e-5 * twist.point.force_n[2]


def test_maps_carry_the_forces_that_act(runs: dict[str, ModeRun]) -> None:
    """Arrows sum to the tangential resultant; the map's pressure integrates to the force."""
    slide = runs["slide"]
    _, arrows = traction_arrows(slide.point, pitch_m=2e-4)
    total = arrows.sum(axis=0) * 2e-4**2
    assert total == pytest.approx(slide.signature.tangential_n[:2], rel=1e-9)
    maps = surface_maps(slide.path, slide.point)
    a, b, c = (maps.points_m[maps.triangles[:, k]] for k in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    force = areas @ maps.pressure_pa[maps.triangles].mean(axis=1)
    assert force == pytest.approx(slide.signature.normal_sum_n, rel=0.1)


def test_figures_are_drawn(runs: dict[str, ModeRun], tmp_path: Path) -> None:
    """A row a run, four panels each."""
    for figure, count in (
        (modes_figure(list(runs.values())), 3),
        (sensors_figure([runs["press"]]), 1),
    ):
        figure.savefig(tmp_path / "figure.png")
        assert [len(part.axes) for part in figure.subfigs] == [4] * count


SIZE, HEIGHT = 8e-3, 3e-3
SOFT, HARD = Material(young_pa=1e5, poisson=0.4), Material(young_pa=4e5, poisson=0.4)
SCENE = Scene(
    pad=BoxPad(size_x_m=SIZE, size_y_m=SIZE, height_m=HEIGHT),
    material=HARD,
    layers=(Layer(share=0.75, material=SOFT), Layer(share=0.25, material=HARD)),
    indenter=Cylinder(diameter_m=2e-3),
    target=Target(depth_m=1e-4),
    preset=Preset.FAST,
)


@pytest.fixture(scope="module")
def model() -> Model:
    """A layered box, whole."""
    mesh = mesh_for(SCENE, symmetric=False)
    assert mesh.layers is not None
    young = np.where(mesh.layers == 0, SOFT.young_pa, HARD.young_pa)
    return Model(
        mesh,
        order=ElementOrder.P2,
        law=law(LawName.STABLE_NEO_HOOKEAN),
        young_pa=young,
        poisson=0.4,
    )


X, Z = np.linspace(-0.45, 0.45, 46) * SIZE, np.linspace(0.005, 1.035, 104) * HEIGHT


def test_a_section_shows_the_gel_and_its_layers(model: Model) -> None:
    """It ends at the gel's top; layers lie in their shares of the height."""
    stress, layers = section(model, model.nodes, X, Z)
    height = np.broadcast_to(Z[:, None] / HEIGHT, layers.shape)
    assert np.array_equal(np.isnan(layers), height > 1.0)
    assert np.array_equal(layers == 1, (height > 0.75) & (height < 1.0))
    assert np.array_equal(np.isnan(stress[..., 0, 0]), np.isnan(layers))
    assert np.nanmax(np.abs(stress)) < 1e-3


def test_even_strain_gives_even_stress_in_each_layer(model: Model) -> None:
    """A stretch along z: the stress jumps between layers and is constant in each."""
    stress, layers = section(model, model.nodes * (1.0, 1.0, 1.05), X, Z, y_m=1e-3)
    soft, hard = (stress[layers == layer][..., 2, 2] for layer in range(2))
    assert soft.min() == pytest.approx(soft.max(), rel=1e-9)
    assert hard.mean() == pytest.approx(4.0 * soft.mean(), rel=1e-6)
    assert hard.min() > 0.0
