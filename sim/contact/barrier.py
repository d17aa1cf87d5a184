"""Warp kernels of barrier contact between the gel's surface and the indenter.

The barrier is integrated over the rest surface, so it converges under refinement:

    E = sum_p A_p kappa f(g_p / d_hat),  f(s) = s - 1 - ln s for s < 1, else 0

so the pressure is kappa / d_hat (1/s - 1). The barrier of Incremental Potential Contact (Li et al.
2020), -(s - 1)^2 ln s, lets the pressure vanish quadratically at d_hat; Newton then frees a point
by a factor of four an iteration, where this one frees it in one. Below s = extension the barrier
goes on as the parabola that joins it with two derivatives, so that Newton may start from a slight
overlap; an accepted equilibrium has every s above the extension, where that changes nothing.
What happens along the surface is ``sim.contact.friction``'s.
"""

from __future__ import annotations

import warp as wp

_STIFFNESS_FACTOR = wp.constant(wp.float64(8.0))  # kappa over E d_hat


@wp.struct
class TouchedSurface:
    """The faces that may be touched, and the numbers of the contact model.

    Attributes:
        faces: Nodes of every face, shape [face_count, face_node_count].
        values: Of the shape functions, shape [point_count, face_node_count].
        areas: At rest, of every contact point [m^2], shape [face_count, point_count].
        young: E of what is touched [Pa], shape [environment_count].
        extensions: Share of d_hat below which the barrier goes on as a parabola, the same shape.
        friction: mu, the same shape.
        distance: d_hat [m].
        slip: s [m], the offset at which sticking has become sliding.
        bonded: Points that touch stick, with k = E / d_hat.
    """

    faces: wp.array2d(dtype=wp.int32)
    values: wp.array2d(dtype=wp.float64)
    areas: wp.array2d(dtype=wp.float64)
    young: wp.array(dtype=wp.float64)
    extensions: wp.array(dtype=wp.float64)
    friction: wp.array(dtype=wp.float64)
    distance: wp.float64
    slip: wp.float64
    bonded: wp.bool


@wp.func
def surface_point(
    surface: TouchedSurface, positions: wp.array(dtype=wp.vec3d), face: wp.int32, point: wp.int32
) -> wp.vec3d:
    """Return the position of a contact point [m]."""
    x = wp.vec3d()
    for k in range(surface.faces.shape[1]):
        x += positions[surface.faces[face, k]] * surface.values[point, k]
    return x


@wp.func
def tangential_part(v: wp.vec3d, n: wp.vec3d) -> wp.vec3d:
    """Return ``v`` without its component along the unit vector ``n``."""
    return v - n * wp.dot(v, n)


@wp.func
def normal_contact(surface: TouchedSurface, b: wp.int32, s: wp.float64):
    """Return energy [J/m^2], pressure [Pa] and its change by the gap [Pa/m] at gap s d_hat < d_hat.

    The pressure is the energy's derivative by the gap: it is negative where the surfaces repel.
    """
    one = wp.float64(1.0)
    r = wp.max(s, surface.extensions[b])
    h = s - r
    scale = _STIFFNESS_FACTOR * surface.young[b]
    energy = r - one - wp.log(r) + h * (one - one / r) + wp.float64(0.5) * h * h / (r * r)
    pressure = scale * (one - one / r + h / (r * r))
    change = scale / surface.distance * (one / (r * r))
    return scale * surface.distance * energy, pressure, change


@wp.kernel(enable_backward=False)
def hessian(
    # Model:
    blocks: wp.array3d(dtype=wp.int32),
    face_values: wp.array2d(dtype=wp.float64),
    # Data in:
    stiffness: wp.array2d(dtype=wp.mat33d),
    # Data out:
    values_out: wp.array(dtype=wp.mat33d),
):
    """Add a face's blocks to the matrix; launches over [face_count, face_node_count]."""
    f, i = wp.tid()
    active = wp.bool(False)
    for q in range(stiffness.shape[1]):
        if wp.ddot(stiffness[f, q], stiffness[f, q]) > wp.float64(0.0):
            active = True
    if active:
        for j in range(i, blocks.shape[2]):
            slot = blocks[f, i, j]
            if slot >= 0:
                total = wp.mat33d()
                for q in range(stiffness.shape[1]):
                    total += stiffness[f, q] * (face_values[q, i] * face_values[q, j])
                wp.atomic_add(values_out, slot // 2, total)
