"""Warp functions of L-BFGS: what the last steps of an environment have shown of its Hessian.

Steps s and changes y of the gradient lie in rings, one of each an environment. The two loops of
Nocedal and Wright, Numerical Optimization, algorithm 7.4, need of them four passes only: products
of all s with the gradient, all y summed, products of all y with the inverse's answer, all s summed.
What the loops need of s . y between is kept as a small matrix. A block of threads has one
environment; on the CPU it is one thread. A GPU has a lane for each of at most 32 steps.
"""

import warp as wp

from sim.device import native_code


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def wait_for_all():
    """Let no thread of a block go on before all have come here."""


@wp.func_native(native_code(__package__, "products"))
def products_with(
    ring: wp.array3d(dtype=wp.float32),
    vector: wp.array2d(dtype=wp.float64),
    count: wp.int32,
    b: wp.int32,
    products: wp.array2d(dtype=wp.float64),
):
    """Set an environment's products of the first ``count`` of a ring with its vector."""


@wp.func_native(native_code(__package__, "sum"))
def add_all(
    ring: wp.array3d(dtype=wp.float32),
    shares: wp.array2d(dtype=wp.float64),
    count: wp.int32,
    b: wp.int32,
    sign: wp.float64,
    base: wp.array2d(dtype=wp.float64),
    vector: wp.array2d(dtype=wp.float64),
):
    """Set an environment's vector to shares of the first ``count`` of a ring and a base."""


@wp.struct
class Memory:
    """What an environment remembers of its steps.

    Of the one under way, shape [environment_count, row_count] over the unknowns, nodes first and
    the tip's height last; of the last ones, shape [environment_count, length, ...] each.
    """

    start: wp.array2d(dtype=wp.float64)  # where the step began: coordinates [m]
    gradient: wp.array2d(dtype=wp.float64)  # there [N]
    trial: wp.array2d(dtype=wp.float64)  # gradient where the step is tried [N]
    renewed: wp.array2d(dtype=wp.float64)  # gradient there once points are held anew [N]
    direction: wp.array2d(dtype=wp.float64)  # of the step [m]
    gaps: wp.array2d(dtype=wp.float64)  # of every contact point where the step began [m]
    steps: wp.array3d(dtype=wp.float32)  # s [m], shape [..., row_count]
    changes: wp.array3d(dtype=wp.float32)  # y [N], likewise
    # s of the row times y of the column [J], shape [..., length]
    table: wp.array3d(dtype=wp.float64)
    # s times the gradient that the last direction began from [J]
    on_gradient: wp.array2d(dtype=wp.float64)
    along: wp.array2d(dtype=wp.float64)  # y times that direction [J]
    products: wp.array2d(dtype=wp.float64)  # of the pass under way
    shares: wp.array2d(dtype=wp.float64)  # of the pass under way
    left: wp.array2d(dtype=wp.float64)  # shares of the first loop
    counts: wp.array(dtype=wp.int32)  # how many are remembered, shape [environment_count]
    next: wp.array(dtype=wp.int32)  # where the next goes, likewise


@wp.func_native(native_code(__package__, "note"))
def note_products(memory: Memory, b: wp.int32, fraction: wp.float64, own: wp.float64):
    """Fill in the table for the newest of an environment.

    ``products`` are those of all s with the new gradient; the step was a fraction of the direction,
    and its own s . y is given [J].
    """


@wp.func_native(native_code(__package__, "first"))
def first_loop(memory: Memory, b: wp.int32):
    """Turn products of all s with the gradient into shares of all y in what the inverse takes."""


@wp.func_native(native_code(__package__, "second"))
def second_loop(memory: Memory, b: wp.int32):
    """Turn products of all y with the inverse's answer into shares of all s in the direction."""
