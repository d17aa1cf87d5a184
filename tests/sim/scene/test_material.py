"""Layered gels: their mesh, their materials, and forces against laminate solutions."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg

from sim.effects.presets import build_model
from sim.material.elastic_body import element_constants
from sim.material.laws.law_and_lame import law
from sim.mesh.cached_tet_mesh import TetMesh, tet_volumes
from sim.mesh.elements import ElementOrder
from sim.mesh.revolved_mesh import Grading, revolved_mesh
from sim.mesh.tetwild import WildSizing, wild_mesh
from sim.press import press
from sim.scene.indenter import Cylinder
from sim.scene.material import LawName, Layer, Material, interface_shares, law_name, sector_factor
from sim.scene.pad import BoxPad, DiscPad
from sim.scene.scene import Effect, Preset, Scene, Target
from sim.solve.loading_path import LoadingPath
from sim.solve.model import Model
from sim.studies.verification.exact import BondedLayers
from tacauchy_rig.core.errors import ConfigError

DOMED = BoxPad(
    size_x_m=20e-3, size_y_m=24e-3, height_m=4e-3, dome_radius_x_m=0.1, dome_radius_y_m=0.2
)
FLAT = BoxPad(size_x_m=12e-3, size_y_m=10e-3, height_m=4e-3)
RIM = Grading(start_m=2e-3, end_m=2e-3, size_m=0.4e-3, growth=2.0)
WEIGHTLESS = ((Effect.GRAVITY, False),)


def gel(ratio: float, *, share: float = 0.9, poisson: float = 0.48) -> tuple[Layer, Layer]:
    """Return a base and a top layer ``ratio`` times as stiff; the softer one has 0.1 MPa."""
    young = 1e5 / min(1.0, ratio)
    base = Material(young_pa=young, poisson=poisson, law=LawName.LINEAR)
    top = replace(base, young_pa=young * ratio)
    return Layer(share=share, material=base), Layer(share=1.0 - share, material=top)


def layered_mesh(pad: BoxPad | DiscPad, *shares: float) -> TetMesh:
    """Return a coarse mesh with interfaces at the shares of the height."""
    return revolved_mesh(
        pad, RIM, centre_m=(0.0, 0.0), sector_count=8, name="test", interface_shares=shares
    )


@pytest.mark.parametrize("pad", [FLAT, DOMED, DiscPad(radius_m=8e-3, height_m=4e-3)])
def test_no_tetrahedron_crosses_an_interface(pad: BoxPad | DiscPad) -> None:
    """Three layers: every tetrahedron lies in its own, and the layers fill the pad."""
    shares = (0.5, 0.925)
    mesh = layered_mesh(pad, *shares)
    assert mesh.layers is not None
    heights = pad.height_at(mesh.vertices[:, 0], mesh.vertices[:, 1])
    place = (mesh.vertices[:, 2] / heights)[mesh.tets]
    bounds = np.array([0.0, *shares, 1.0])
    assert np.all(place >= bounds[mesh.layers][:, None] - 1e-9)
    assert np.all(place <= bounds[mesh.layers + 1][:, None] + 1e-9)
    volumes = tet_volumes(mesh.vertices, mesh.tets)
    assert volumes.min() > 0.0
    parts = np.bincount(mesh.layers, weights=volumes) / volumes.sum()
    assert parts == pytest.approx(np.diff(bounds), abs=2e-3)


@pytest.mark.slow
def test_ftetwild_keeps_to_the_interface() -> None:
    """Labels fill the layers' volumes, with nodes on the interface itself."""
    pad = BoxPad(size_x_m=6e-3, size_y_m=6e-3, height_m=3e-3)
    mesh = wild_mesh(pad, WildSizing(), name="small", interface_shares=(0.7,))
    assert mesh.layers is not None
    volumes = tet_volumes(mesh.vertices, mesh.tets)
    parts = np.bincount(mesh.layers, weights=volumes) / volumes.sum()
    assert parts == pytest.approx([0.7, 0.3], abs=0.02)
    assert np.sum(np.abs(mesh.vertices[:, 2] - 0.7 * 3e-3) < 1e-12) > 10


def test_layer_too_thin_for_ftetwild_is_refused() -> None:
    """The message says by how much fTetWild moves surfaces."""
    with pytest.raises(ConfigError, match=r"too thin .* by up to"):
        wild_mesh(FLAT, WildSizing(), name="thin", interface_shares=(0.99,))


@pytest.mark.parametrize(
    ("shares", "message"), [((0.5, 0.4), "sum to .* = 0.9, not 1"), ((1.5, -0.5), "layer 2")]
)
def test_shares_that_do_not_fill_the_pad_are_refused(
    shares: tuple[float, ...], message: str
) -> None:
    """The message has the sum, or the layer."""
    material = Material(young_pa=1e5, poisson=0.4)
    with pytest.raises(ConfigError, match=message):
        interface_shares([Layer(share=share, material=material) for share in shares])


def test_layers_of_different_laws_are_refused() -> None:
    """One law for all."""
    base, top = gel(2.0)
    other = replace(top, material=replace(top.material, law=LawName.NEO_HOOKEAN))
    with pytest.raises(ConfigError, match="different laws: linear, neo-hookean"):
        law_name(base.material, (base, other))


def test_mesh_of_other_layers_is_refused() -> None:
    """Two layers on a mesh of one."""
    mesh = revolved_mesh(FLAT, RIM, centre_m=(0.0, 0.0), sector_count=8, name="one")
    with pytest.raises(ConfigError, match="'one' has 1 layers, the gel 2"):
        element_constants(mesh, [layer.material for layer in gel(2.0)])


def test_only_a_stiff_layer_above_a_soft_one_needs_more_sectors() -> None:
    """Not one below, and not a little stiffness."""
    assert sector_factor(()) == 1.0
    assert sector_factor(gel(10.0)) == 1.0
    assert sector_factor(gel(1e-4)) == 1.0
    assert sector_factor(gel(1e4)) == pytest.approx(100.0**0.25)


def test_two_layers_of_one_material_are_that_material() -> None:
    """The same press on the same mesh, to 1e-9."""
    material = Material(young_pa=4e5, poisson=0.48)
    halves = (Layer(share=0.6, material=material), Layer(share=0.4, material=material))
    scene = Scene(
        pad=DOMED,
        material=material,
        layers=halves,
        indenter=Cylinder(diameter_m=5e-3, fillet_m=0.2e-3),
        target=Target(depth_m=0.15e-3),
        preset=Preset.FAST,
    )
    layered = build_model(scene)
    plain = Model(
        replace(layered.mesh, layers=None),
        order=layered.reference.order,
        law=layered.law,
        young_pa=material.young_pa,
        poisson=material.poisson,
        contact_options=layered.contact_options,
    )
    forces = [
        LoadingPath(model, scene.indenter).advance(0.15e-3).force_n[2] for model in (layered, plain)
    ]
    assert forces[0] == pytest.approx(forces[1], rel=1e-9)


@pytest.mark.parametrize("order", list(ElementOrder))
@pytest.mark.parametrize("ratio", [3.0, 1e4, 1e-4])
def test_confined_compression_is_the_laminates(order: ElementOrder, ratio: float) -> None:
    """Rollers at the sides: F = A d / sum(h / M), M = E (1 - nu) / ((1 + nu) (1 - 2 nu)).

    The solution is linear in each layer, so that both elements have it exactly.
    """
    layers = gel(ratio, share=0.7)
    mesh = layered_mesh(FLAT, 0.7)
    young, poisson = element_constants(mesh, [layer.material for layer in layers])
    model = Model(mesh, order=order, law=law(LawName.LINEAR), young_pa=young, poisson=poisson)
    upper = model.pattern.upper(model.rest_hessian_data())
    stiffness = upper + scipy.sparse.triu(upper, 1).T
    half_x, half_y = FLAT.half_extents()
    sides = np.zeros(model.nodes.shape, dtype=bool)
    sides[:, 0] = np.abs(model.nodes[:, 0] - half_x) < 1e-9
    sides[:, 1] = np.abs(model.nodes[:, 1] - half_y) < 1e-9
    top = np.zeros_like(sides)
    top[:, 2] = np.abs(model.nodes[:, 2] - FLAT.height_m) < 1e-9
    pushed = model.pattern.unknowns(top.astype(float)) > 0.5
    free = ~pushed & (model.pattern.unknowns(sides.astype(float)) < 0.5)
    depth = 1e-5
    moved = np.where(pushed, -depth, 0.0)
    moved[free] = scipy.sparse.linalg.spsolve(
        stiffness[free][:, free].tocsc(), -(stiffness @ moved)[free]
    )
    force = -model.mesh.symmetry.copies * float((stiffness @ moved)[pushed].sum())
    compliance = sum(
        layer.share
        * FLAT.height_m
        * (1.0 + layer.material.poisson)
        * (1.0 - 2.0 * layer.material.poisson)
        / (layer.material.young_pa * (1.0 - layer.material.poisson))
        for layer in layers
    )
    assert force == pytest.approx(FLAT.size_x_m * FLAT.size_y_m * depth / compliance, rel=1e-8)


@pytest.mark.timeout(400)
@pytest.mark.parametrize(
    ("ratio", "share", "radius_m", "tolerance"),
    [pytest.param(4.0, 0.925, 2.5e-3, 0.05, marks=pytest.mark.slow), (1e-4, 0.925, 2.5e-3, 0.03)],
)
def test_punch_on_a_laminate(ratio: float, share: float, radius_m: float, tolerance: float) -> None:
    """F against the laminate's, up to a stiffness ratio of 10,000; hard case 8 is stiff on soft.

    Stiffer skins than these pull on a wide punch, which gel does not: the reference would not hold.
    """
    layers = gel(ratio, share=share)
    scene = Scene(
        pad=DiscPad(radius_m=20e-3, height_m=4e-3),
        material=layers[1].material,
        layers=layers,
        indenter=Cylinder(diameter_m=2.0 * radius_m),
        target=Target(depth_m=10e-6),
        preset=Preset.BALANCED,
        barrier_m=1e-7,
        effects=WEIGHTLESS,
    )
    result = press(scene)
    solution = BondedLayers.of_scene(scene)
    expected = solution.punch_force(radius_m=radius_m, depth_m=10e-6)
    assert result.force_n[2] == pytest.approx(expected, rel=tolerance)
    assert result.force_balance_relative < 1e-6
    assert result.point.equilibrium.residual_n < 1e-6 * result.force_n[2]
    assert result.estimated_force_error_relative is None
