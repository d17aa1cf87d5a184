"""A sensor's model for presses at any place: mesh, compliance of the contact, error of F_z.

A mesh is stiffer than the gel, above all under pressure p and shear t that change within its faces.
Contact is therefore made compliant, by a share of an edge times p over E / (1 - nu^2). This offsets
most of the error, halves the steps of a descent, and overcorrects wide contacts. What remains is

    log(F / F_fine) = (form + growing q^2 a / H) A / F_z^2
                        * integral of (t^2 - p^2 + unresolved p (p - L p)) h / z
                        + narrow (h / (c^2 a))^1.5 + wide sqrt(h / H)
                        + layers (1 - E_min / E_max) h / H

with the edge length h at the surface, the pad's height z there and H in its middle, the contact's
area A, the radius a of a disc of this area, q = F_z (1 - nu^2) / (A E), and L p, the linear
function on each face that is closest to p. The integral is the work that a mesh's surface does too
little under traction it does not resolve, less what the compliant contact does; A / z is the
stiffness of a layer over E. Growing is how gel stiffens that is pressed hard and wide against its
height; it is zero under sharp bodies. A contact of few nodes meets the compliance that these have:
c is that of nodes amid edges, which each mesh's inverse tells, times E h / (1 - nu^2), with the
share of it that the pad's base takes off. Under sharp bodies, those with fillets up to h / 4
included, contact gives less, and form, narrow and wide are their own. Where points lie beside an
edge decides how much pressure acts aside. Under bodies without fillets

    (1 - mu / 0.3) (0.116 q - 0.28 N / F_z)

is added below mu = 0.3, with N the pressure's sum less its part along the indenter's axis. The
numbers were fitted to 546 presses of balls, punches and prisms on two sensors, a third with
friction, at edges of 0.9 to 2.5 mm, against presses on fine meshes of their own, that of layers to
40 on 9DTact, those of fillets and of N to 75 on two sensors at 1.25 mm, and those under rounded
bodies to 107 on two sensors at 1.25 mm, 30 of them deep where DIGIT's gel is low.

``overlap_kernels`` describes how the force of light contacts is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.batch.contact_inverse import ContactInverse
from sim.batch.overlap_kernels import Resting
from sim.contact.surface_and_grip import ContactOptions
from sim.device import filled
from sim.material.elastic_body import element_constants
from sim.material.laws.law_and_lame import law
from sim.mesh.brick_refinement import sensor_mesh
from sim.mesh.elements import FACE_EDGES, QUARTERS, ElementOrder, quadratic_triangle_values
from sim.scene.indenter import Cylinder, Indenter, MeshIndenter
from sim.scene.material import LawName, Layer, Material, interface_shares
from sim.scene.pad import BoxPad
from sim.solve.model import Model
from tacauchy_rig.core.arrays import FloatArray
from tacauchy_rig.core.errors import ConfigError

# Of the pad's height: a barrier that makes F_z 1 % too large and halves the steps.
BARRIER_SHARE = 0.01
# Edges of the mesh times the pressure over E / (1 - nu^2) by which contact gives way, under a
# rounded body and under a sharp one, whose edges would sink in.
_GIVES, _GIVES_SHARP = 0.05, 0.02
# Edges at which sticking has become sliding; a tenth of it changes forces by under 1 % (median).
_SLIP_SHARE = 0.004
# Edges of the mesh by which a point may overlap; in models that are made otherwise none may.
_OVERLAP_SHARE = 0.4
# Bias of F_z: by layers, and what is not linear of pressure; then wide, narrow, form and growing,
# under a rounded body, one with a small fillet, and a sharp one.
_LAYERS, _UNRESOLVED = 0.21, 1.9
_TERMS = np.array(
    [[0.07, 0.32, 0.14, 0.14], [0.141, 0.269, 0.0955, 0.0], [0.094, 0.1345, 0.0955, 0.0]]
)
# Rims of which a fillet is small; aside and pressed, and the friction that leaves none of them.
_FILLET, _ASIDE, _PRESSED, _ROUGH = 2.5, -0.28, 0.116, 0.3
# Of a half-space's compliance [(1 - nu^2) / (E h)] that a base h / H edges below takes off, over
# h / H, at nu 0.48 (Dimitriadis et al. 2002), and c of layered gels, whose is not that of a mesh.
_BASE, _USUAL = 0.55, 1.9
# Of half a pad: what lies farther out is on its sides.
_INSIDE = 0.999
# What may remain of it: of all, and by edges, layers and narrow contacts.
_LEFT, _WIDE_LEFT, _LAYERS_LEFT, _NARROW_LEFT = 0.01, 0.08, 0.14, 0.028


class ForceBias(NamedTuple):
    """The bias of environments' forces, and what may remain of it; relative to them.

    ``known`` has factors of 1, A^(-3/4), S A / F_z^2, N / F_z, F_z / A and S A^(-1/2) with the sums
    S and N that ``BatchKernels`` makes, shape [count, 6]; ``left`` of the first two, [count, 2].
    The bias has also linear x + quadratic x^2 with x = log(F_z / N), held between two ends:
    ``by_force``, shape [count, 4].
    """

    known: FloatArray
    by_force: FloatArray
    left: FloatArray

    def of(self, which: Sequence[int] | NDArray[np.integer[Any]]) -> ForceBias:
        """Return the bias of bodies by their places, shape [count, ...]."""
        return ForceBias(*(each[np.asarray(which)] for each in self))

    def scaled(self, friction: FloatArray, moduli_pa: FloatArray) -> ForceBias:
        """Return the bias at friction and E / (1 - nu^2) of environments, from that at 0 and 1."""
        known, left = self.known.copy(), np.maximum(1.0 - friction / _ROUGH, 0.0)
        known[:, 3:5] *= left[:, None]
        known[:, 4:] /= moduli_pa[:, None] ** [1, 2]
        return self._replace(known=known)


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
        ConfigError: The edge length cannot be, or the mesh would have too many tetrahedra.
    """
    if not 0.0 < edge_m <= 2.0 * pad.height_m:
        raise ConfigError(
            f"edge_m is {edge_m:g} m; in a gel of {pad.height_m:g} m it is above 0 and at most "
            "twice as long",
            remedy="give metres, such as 1.25e-3",
        )
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


def reach_of(model: Model) -> float:
    """Return the gap within which a point's face may touch [m]: that of contact, and an edge."""
    return model.contact_options.distance_m + edge_of(model)


def sharp(indenters: Sequence[Indenter], rim_m: float) -> NDArray[np.int_]:
    """Return 2 for edges rounded by a radius [m] at most, or unknown, 1 for 2.5 of it, 0 beyond."""
    fillets_m = np.full(len(indenters), np.inf)
    for k, each in enumerate(indenters):
        if isinstance(each, Cylinder | MeshIndenter):
            fillets_m[k] = each.fillet_m if isinstance(each, Cylinder) else 0.0
    return np.add(fillets_m <= rim_m, fillets_m <= _FILLET * rim_m, dtype=np.int_)


def stiffness_of(model: Model, edged: NDArray[np.bool_]) -> FloatArray:
    """Return the stiffness of contact over E d_hat under bodies that are sharp, or are not."""
    sharper = _GIVES / _GIVES_SHARP if model.contact_options.overlap else 1.0
    return model.contact_options.stiffness * np.where(edged, sharper, 1.0)


def pressure_form(model: Model) -> FloatArray:
    """Return the quadratic form of pressures at a face's points that biases forces."""
    linear, weights = model.reference.face_points, model.reference.face_weights[:, None]
    followed = linear @ np.linalg.solve(linear.T @ (weights * linear), (weights * linear).T)
    return (_UNRESOLVED - 1.0) * np.eye(len(linear)) - _UNRESOLVED * followed


def face_shares(model: Model) -> FloatArray:
    """Return the edge length over the pad's height at every face."""
    edge_m, heights_m = edge_of(model), model.nodes[model.faces].mean(axis=1)[:, 2]
    return np.asarray(edge_m / np.maximum(heights_m, edge_m))


def quarter_values(model: Model) -> FloatArray:
    """Return a face's shape functions at points of its quarters, [point_count, 4, node_count]."""
    corners = np.concatenate([np.eye(3), np.eye(3)[np.array(FACE_EDGES)].mean(axis=1)])
    images = np.einsum("qk,pkx->qpx", model.reference.face_points, corners[np.array(QUARTERS)])
    return quadratic_triangle_values(images)


def bias_of(model: Model, inverse: ContactInverse) -> ForceBias:
    """Return the bias by ``sharp``; none where it is not known."""
    if not model.contact_options.overlap:
        none = np.zeros((3, 6))
        return ForceBias(none, none[:, :4], np.full((3, 2), np.nan))
    edge_m, (young_pa, poisson) = edge_of(model), model.materials
    wide, narrow = edge_m / model.height_m, (edge_m * np.sqrt(np.pi)) ** 1.5
    layered = (1.0 - young_pa.min() / young_pa.max()) * wide
    soft = _USUAL
    if not layered:
        unit = (1.0 - poisson.max() ** 2) / (young_pa.max() * edge_m)
        soft = inverse.middle_compliance() / unit + _BASE * wide
    known, rise = np.zeros((3, 6)), 1.0 / (np.sqrt(np.pi) * model.height_m)
    known[:, [0, 1, 2, 5]] = _TERMS * [np.sqrt(wide), narrow / soft**3, 1.0, rise]
    known[:, 0] += _LAYERS * layered
    known[2, 3:5] = _ASIDE, _PRESSED
    left = [_LEFT + _WIDE_LEFT * wide + _LAYERS_LEFT * layered, _NARROW_LEFT * narrow]
    return ForceBias(known, np.zeros((3, 4)), np.array([left] * 3))


def light_moduli(model: Model, young_pa: FloatArray, poisson: FloatArray) -> FloatArray:
    """Return E / (1 - nu^2) of what is touched [Pa], zero where light contacts' F is unknown.

    So it is in layered gels, and in models that ``sensor_model`` did not make.
    """
    young, _ = model.materials
    is_known = model.contact_options.overlap and young.min() == young.max()
    return np.asarray(young_pa / (1.0 - poisson**2) * bool(is_known))


def resting_gel(model: Model) -> Any:
    """Return the resting gel of a sensor's model as ``overlap_kernels.Resting``."""
    touched = model.nodes[np.unique(model.faces)]
    half_m = np.abs(touched[:, :2]).max(axis=0)
    on_top = (np.abs(touched[:, :2]) < _INSIDE * half_m).all(axis=1)  # the others are on the sides
    x, y, z = touched[on_top].T
    fitted = np.linalg.lstsq(np.column_stack([np.ones(len(x)), -x * x, -y * y]), z, rcond=None)[0]
    names = ("height", "bend_x", "bend_y", "half_x", "half_y")
    return filled(Resting, **dict(zip(names, [*fitted.tolist(), *half_m.tolist()], strict=True)))
