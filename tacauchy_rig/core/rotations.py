"""Rotation vectors turned by hand: where every cycle of an arm or of a guard needs them.

scipy's Rotation takes 0.1 ms for one, of a cycle's 2, and as long to import as all else that an
emulator needs.
"""

import math

from tacauchy_rig.core.run import Vector3


def rotated(vector: Vector3, rotation_vector: Vector3) -> Vector3:
    """Return a vector turned by a rotation vector [rad]: Rodrigues' formula."""
    ux, uy, uz = rotation_vector
    angle = math.hypot(ux, uy, uz)
    if angle < 1e-12:
        return vector
    ux, uy, uz = ux / angle, uy / angle, uz / angle
    x, y, z = vector
    cosine, sine = math.cos(angle), math.sin(angle)
    along = (1.0 - cosine) * (ux * x + uy * y + uz * z)
    return (
        cosine * x + sine * (uy * z - uz * y) + along * ux,
        cosine * y + sine * (uz * x - ux * z) + along * uy,
        cosine * z + sine * (ux * y - uy * x) + along * uz,
    )


def composed(first: Vector3, second: Vector3) -> Vector3:
    """Return the rotation vector [rad] of ``second`` followed by ``first`` (matrix product)."""
    w1, x1, y1, z1 = quaternion(first)
    w2, x2, y2, z2 = quaternion(second)
    w = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2
    x = w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2
    y = w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2
    z = w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.hypot(x, y, z)
    factor = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, w) / sine
    return (factor * x, factor * y, factor * z)


def quaternion(rotation_vector: Vector3) -> tuple[float, float, float, float]:
    """Return w, x, y, z of a rotation vector [rad]."""
    x, y, z = rotation_vector
    angle = math.hypot(x, y, z)
    if angle < 1e-12:
        return (1.0, 0.5 * x, 0.5 * y, 0.5 * z)
    factor = math.sin(0.5 * angle) / angle
    return (math.cos(0.5 * angle), factor * x, factor * y, factor * z)
