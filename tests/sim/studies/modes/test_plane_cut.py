"""A cut through the gel: it covers the plane, and even strain gives even stress."""

from __future__ import annotations

import numpy as np
import pytest

from sim.effects.presets import mesh_for
from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder
from sim.scene.indenter import Cylinder
from sim.scene.material import LawName, Layer, Material
from sim.scene.pad import BoxPad
from sim.scene.scene import Preset, Scene, Target
from sim.solve.model import Model
from sim.studies.modes.figures import PlaneCut, cut

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


def areas_of(section: PlaneCut) -> np.ndarray:
    """Return the triangles' areas [m^2]."""
    a, b, c = (section.points_m[section.triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    return np.asarray(0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]))


def test_a_cut_covers_the_plane_once(model: Model) -> None:
    """The triangles' areas sum to the rectangle's, each layer's to its share."""
    section = cut(model, model.nodes)
    areas = areas_of(section)
    assert areas.sum() == pytest.approx(SIZE * HEIGHT, rel=1e-9)
    assert areas[section.layers == 1].sum() == pytest.approx(0.25 * SIZE * HEIGHT, rel=1e-6)
    assert np.abs(section.stress_pa).max() < 1e-3


def test_slivers_are_little_of_a_cut(model: Model) -> None:
    """Without them nothing is seen to be missing, and what is left is thick."""
    section = cut(model, model.nodes)
    thick = section.without_slivers(1e-3 * HEIGHT)
    assert len(thick.triangles) == len(thick.layers) < len(section.triangles)
    assert areas_of(thick).sum() == pytest.approx(SIZE * HEIGHT, rel=1e-3)
    assert areas_of(thick).min() > 0.5 * (1e-3 * HEIGHT) ** 2


def test_even_strain_gives_even_stress_in_each_layer(model: Model) -> None:
    """A stretch along z: the stress jumps between layers and is constant in each."""
    stretched = model.nodes * (1.0, 1.0, 1.05)
    section = cut(model, stretched, y_m=1e-3)
    across = section.stress_pa[section.triangles][..., 2, 2]
    soft, hard = across[section.layers == 0], across[section.layers == 1]
    assert soft.min() == pytest.approx(soft.max(), rel=1e-9)
    assert hard.mean() == pytest.approx(4.0 * soft.mean(), rel=1e-6)
    assert hard.min() > 0.0
