"""A sensor's model for presses at any place: mesh, compliance of the contact, error of F_z.

Elements as wide as a contact are too stiff: F_z is 1 to 60 % too large. The contact is therefore
made compliant, by a share of an edge times the pressure over E / (1 - nu^2). This offsets most of
the error, halves the steps of a descent, and overcorrects wide contacts a little. What remains is

    F / F_fine = 1 + share h / H + slope (h / a)^1.5 + layers (1 - E_min / E_max) (h / H)^1.5

with the edge length h at the surface, the pad's height H and the radius a of a disc of the
contact's area A. The numbers were fitted to 340 forces of drawn balls and rounded punches on two
sensors and meshes of three edges, against presses on fine meshes of their own, and that of layers
to 24 on 9DTact; what remains was, for 19 forces of 20. It is not within 1 %: by where a ball of
5 to 12 mm lies in a cell of 2.5 mm F_z differs by 1 to 2 % (standard deviation). With friction of
0.3 to 1 and under sharp prisms it was compared with finer meshes of the same kind only; ``study
bench --part unlike`` gives the share within.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from sim.contact.contact_surface import ContactOptions
from sim.material.elastic_body import element_constants
from sim.material.laws.tangent import law
from sim.mesh.elements import ElementOrder
from sim.mesh.refinement import sensor_mesh
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter
from sim.scene.material import LawName, Layer, Material, interface_shares
from sim.scene.pad import BoxPad
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray

# Of the pad's height: a barrier that makes F_z 1 % too large and halves the steps.
BARRIER_SHARE = 0.01
# Edges of the mesh times the pressure over E / (1 - nu^2) by which contact gives way, under a
# rounded body and under a sharp one, whose edges would sink in.
_GIVES, _GIVES_SHARP = 0.05, 0.02
# The bias is known of models that give way like that, up to this factor: a mesh's edges are not
# exactly as long as was asked.
_SAME_GIVES = 2.0
# Edges of the mesh at which sticking has become sliding. A tenth of it takes more evaluations and
# changes forces by less than 1 % in the median.
_SLIP_SHARE = 0.004
# Edges of the mesh by which a point may overlap; and of the radius below which a body is sharp.
_OVERLAP_SHARE, _SHARP_SHARE = 0.4, 0.25


class Rim(IntEnum):
    """How a body's edge compares with a mesh's."""

    ROUND = 0
    """It has none: a ball."""
    FILLET = 1
    """Its radius is more than a quarter of an edge's length."""
    NARROW = 2
    """It is less."""
    SHARP = 3
    """It is zero, or not known."""


# Share of the bias by ``Rim``, its slope, and what layers add; then all of what remains.
_SHARES, _SLOPE, _LAYERS = np.array([-0.155, -0.066, 0.088, 0.0]), 0.068, 0.81
_SHARES_LEFT, _SLOPE_LEFT, _LAYERS_LEFT = np.array([0.10, 0.10, 0.25, 0.30]), 0.03, 0.25


class ForceBias(NamedTuple):
    """The bias of environments' forces, and what may remain of it; relative to them.

    Each is a constant of the environment, shape [count], plus a slope times A^(-3/4).
    """

    constant: FloatArray
    slope: float
    constant_left: FloatArray
    slope_left: float


def sensor_model(
    pad: BoxPad,
    material: Material,
    *,
    layers: Sequence[Layer] = (),
    edge_m: float = 1.25e-3,
    friction: float = 0.0,
    law_name: LawName = LawName.STABLE_NEO_HOOKEAN,
    device: str = "cpu",
) -> Model:
    """Mesh a sensor's pad for presses at any place, and set up its model.

    Args:
        pad: Pad of the sensor.
        material: Material of the gel, or of its topmost layer, which touches the indenter.
        layers: Layers of the gel from the base upwards; empty for a gel of one material.
        edge_m: Edge length at the surface [m]; nodes are half of it apart.
        friction: Coulomb coefficient of environments without their own; zero makes a model
            without friction.

    Raises:
        ConfigError: The mesh would have too many tetrahedra.
    """
    distance_m = BARRIER_SHARE * pad.height_m
    options = ContactOptions(
        distance_m=distance_m,
        friction=friction,
        slip_m=_SLIP_SHARE * edge_m,
        extension=1.0,
        overlap=_OVERLAP_SHARE * edge_m / distance_m,
        stiffness=distance_m / (_GIVES * edge_m * (1.0 - material.poisson**2)),
    )
    mesh = sensor_mesh(pad, edge_m=edge_m, interface_shares=interface_shares(layers))
    materials = [layer.material for layer in layers] or [material]
    young_pa, poisson = element_constants(mesh, materials)
    return Model(
        mesh,
        order=ElementOrder.P2,
        law=law(law_name),
        young_pa=young_pa,
        poisson=poisson,
        contact_options=options,
        device=device,
    )


def edge_of(model: Model) -> float:
    """Return the edge length at a model's surface [m]."""
    return float(np.sqrt(2.0 * np.median(model.discretisation.face_areas)))


def rims_of(model: Model, indenters: Sequence[Indenter]) -> FloatArray:
    """Return the ``Rim`` of every body on a model's mesh, shape [count]."""
    narrow_m = _SHARP_SHARE * edge_of(model)
    return np.array([_rim(each, narrow_m) for each in indenters])


def stiffness_of(model: Model, rims: FloatArray) -> FloatArray:
    """Return the stiffness of contact over E d_hat under bodies, shape [count]."""
    sharper = _GIVES / _GIVES_SHARP if _gives_way(model) else 1.0
    return model.contact_options.stiffness * np.where(rims <= Rim.FILLET, 1.0, sharper)


def bias_of(model: Model, rims: FloatArray) -> ForceBias:
    """Return the bias of forces on a model; none, with NaN left, where it is not known."""
    edge_m = edge_of(model)
    if not _gives_way(model):
        return ForceBias(np.zeros(len(rims)), 0.0, np.full(len(rims), np.nan), 0.0)
    wide, narrow = edge_m / model.height_m, (edge_m * np.sqrt(np.pi)) ** 1.5
    layered = (1.0 - model.materials[0].min() / model.materials[0].max()) * wide**1.5
    constant = _SHARES[rims] * wide + _LAYERS * layered
    left = _SHARES_LEFT[rims] * wide + _LAYERS_LEFT * layered
    return ForceBias(constant, _SLOPE * narrow, left, _SLOPE_LEFT * narrow)


def _gives_way(model: Model) -> bool:
    """Return whether contact gives way as ``sensor_model`` lets it."""
    contact, softness = model.contact_options, 1.0 - float(np.median(model.materials[1])) ** 2
    gives = contact.distance_m / (contact.stiffness * edge_of(model) * softness)
    return 1.0 / _SAME_GIVES < gives / _GIVES < _SAME_GIVES


def _rim(indenter: Indenter, narrow_m: float) -> Rim:
    if isinstance(indenter, Cylinder) and indenter.fillet_m > 0.0:
        return Rim.FILLET if indenter.fillet_m >= narrow_m else Rim.NARROW
    return Rim.SHARP if isinstance(indenter, Cylinder | MeshIndenter) else Rim.ROUND
