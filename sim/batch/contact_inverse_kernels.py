"""Warp kernels that correct the undeformed gel's inverse for the nodes in contact.

Contact adds a stiffness C at the touching nodes: the stiffness is K = K0 + N C N^T, N picking those
nodes, and Woodbury's identity gives

    K^-1 = K0^-1 - K0^-1 N S^-1 N^T K0^-1,  S = C^-1 + N^T K0^-1 N

so that only the block of K0^-1 at the surface (``compliance``) and a small dense system for every
environment are needed. A load adds the indenter's height: a further unknown, held by a weak spring
``held``, to which every touching node is tied. One averaged normal for a node instead of three
directions takes up to eight times as many evaluations under a punch's rim. A block of threads has
one environment; on a CPU it is one thread.
"""

# Annotations are evaluated where they stand: those of native functions name a type given below.
from functools import cache
from typing import Any

import warp as wp

from sim.device import native_code
from sim.solve.descent_state import Act, Descent

CAPACITY = 223
"""Touching nodes of an environment at most; more are left uncorrected."""

WIDE = 16
"""Pivots of a small system that are swept at once."""

# Steps that a correction serves; but only the first one where that leaves more than a share of the
# contact force, since it has changed what touches.
_SERVED, _CHANGED = wp.constant(8), wp.constant(wp.float64(0.1))


@wp.struct
class Correction:
    """What the correction knows of the surface, and of every environment's contact."""

    rows: wp.array2d(dtype=wp.int32)  # unknowns of a surface node, shape [surface_count, 3]
    # surface nodes of a face, -1 for fixed ones, shape [face_count, face_node_count]
    faces: wp.array2d(dtype=wp.int32)
    # corners of faces at a surface node, -1 after the last, shape [surface_count, most of a node]
    around: wp.array2d(dtype=wp.int32)
    values: wp.array2d(dtype=wp.float32)  # shape functions, shape [point_count, face_node_count]
    # block of K0^-1 [m/N], shape [3 surface_count, 3 surface_count]
    compliance: wp.array2d(dtype=wp.float32)
    held: wp.float64  # spring of the indenter's height where it is an unknown [N/m]
    shares: wp.array(dtype=wp.float64)  # E that K0 is of over its own, shape [environment_count]
    renews: wp.array(dtype=wp.int32)  # 1 where the correction is made anew, shape likewise
    # of every contact point [N/m]; shape [environment_count, face_count, point_count]
    stiffness: wp.array3d(dtype=wp.mat33f)
    touching: wp.array2d(dtype=wp.int32)  # 1 where a node is, [environment_count, surface_count]
    local: wp.array2d(dtype=wp.int32)  # place of a node among the touching, or -1, likewise
    counts: wp.array(dtype=wp.int32)  # touching nodes, shape [environment_count]
    listed: wp.array2d(dtype=wp.int32)  # their numbers, shape [environment_count, capacity]
    along: wp.array2d(dtype=wp.float32)  # scratch of the sweep, [environment_count, size WIDE]
    inverse: wp.array3d(dtype=wp.float32)  # -S^-1, shape [environment_count, size, size]


@wp.func_native(native_code(__package__, "list"))
def _list_touching(c: Correction, b: wp.int32): ...


@wp.func_native(native_code(__package__, "factor", PITCH=3 * CAPACITY + 1, WIDE=WIDE))
def _factor_small(c: Correction, b: wp.int32, pushed: wp.bool): ...


@wp.kernel(enable_backward=False)
def choose(d: Descent, c: Correction):
    """Say whose correction is made anew, and forget what touched there.

    Launches over [environment_count, surface_count].
    """
    b, s = wp.tid()
    due = d.since[b] % _SERVED == 0
    if d.since[b] == 1 and d.residual[b] > _CHANGED * d.scale[b]:
        due = True
    renews = d.act[b] == Act.SOLVE and due
    if s == 0:
        c.renews[b] = wp.where(renews, 1, 0)
    if renews:
        c.touching[b, s] = 0


@wp.kernel(enable_backward=False, module="unique")
def list_touching(c: Correction):
    """List the touching nodes; launches over [environment_count, threads of a block]."""
    b, _thread = wp.tid()
    if c.renews[b] == 1:
        _list_touching(c, b)


@wp.kernel(enable_backward=False, module="unique")
def factor(d: Descent, c: Correction):
    """Make the small systems' inverses; launches over [environment_count, threads of a block]."""
    b, _thread = wp.tid()
    if c.renews[b] == 1:
        _factor_small(c, b, d.pushed[b] == 1)


@cache
def correct_kernels(kind: Any) -> tuple[Any, Any]:
    """Build the kernels that correct what the inverse is asked for, and the answer for a tip.

    Args:
        kind: Warp type of what the inverse takes, float16 or float64.
    """
    name = {wp.float16: "(wp::half)(float)", wp.float64: "(double)"}[kind]
    gives = wp.float32 if kind is wp.float16 else wp.float64
    made = {"enable_backward": False, "module": "unique"}

    @wp.func_native(native_code(__package__, "correct", SIZE=3 * CAPACITY, KIND=name))
    def correct_one(
        c: Correction,
        b: wp.int32,
        slot: wp.int32,
        pushed: wp.bool,
        tip_row: wp.int32,
        unit: wp.float64,
        weights: wp.array(dtype=wp.float32),
        given: wp.array2d(dtype=kind),
        found: wp.array2d(dtype=gives),
        out: wp.array2d(dtype=kind),
        tips: wp.array(dtype=wp.float64),
    ): ...

    @wp.kernel(**made)
    def correct(
        d: Descent,
        c: Correction,
        tip_row: wp.int32,
        units: wp.array(dtype=wp.float64),
        weights: wp.array(dtype=wp.float32),
        given: wp.array2d(dtype=kind),
        found: wp.array2d(dtype=gives),
        out: wp.array2d(dtype=kind),
        tips: wp.array(dtype=wp.float64),
    ):
        b, _thread = wp.tid()
        if d.act[b] == Act.SOLVE:
            pushed = d.pushed[b] == 1
            own = units[b]
            correct_one(c, b, d.slot[b], pushed, tip_row, own, weights, given, found, out, tips)

    @wp.kernel(**made)
    def set_tip(
        d: Descent,
        tip_row: wp.int32,
        tips: wp.array(dtype=wp.float64),
        found: wp.array2d(dtype=gives),
    ):
        b = wp.tid()
        if d.act[b] == Act.SOLVE:
            tip = wp.float64(0.0)
            if d.pushed[b] == 1:
                tip = tips[b]
            found[d.slot[b], tip_row] = found.dtype(tip)

    return correct, set_tip
