"""Warp functions of L-BFGS: what the last steps of an environment have shown of its Hessian.

Steps s and changes y of the gradient lie in rings, one of each an environment. The two loops of
Nocedal and Wright, Numerical Optimization, algorithm 7.4, need of them four passes only: products
of all s with the gradient, all y summed, products of all y with the inverse's answer, all s summed.
What the loops need of s . y between is kept as a small matrix. A block of threads has one
environment; on the CPU it is one thread.
"""

from __future__ import annotations

import warp as wp

LONGEST = 32
"""Most steps that are remembered: a GPU has a lane for each."""

_AT = """
    const int rows = ring.shape[2];
    const float* of = ring.data + (size_t)b * ring.shape[1] * rows;
"""
# Sums may be taken in any order, so that the processor takes several terms at once.
_PRODUCTS = f"""
    {_AT}
    const double* v = vector.data + (size_t)b * rows;
    double* out = products.data + (size_t)b * products.shape[1];
#if defined(__CUDA_ARCH__)
    // Few products are shared out, so that every warp has a part of one.
    __shared__ double found[32];
    const int lane = threadIdx.x & 31, warps = blockDim.x >> 5;
    const int parts = max(1, warps / max(1, count));
    const int part = (threadIdx.x >> 5) % parts;
    for (int i = (threadIdx.x >> 5) / parts; i < count; i += max(1, warps / parts)) {{
        double sum = 0.0;
        #pragma unroll 8
        for (int r = lane + 32 * part; r < rows; r += 32 * parts)
            sum += of[(size_t)i * rows + r] * v[r];
        for (int o = 16; o > 0; o >>= 1) sum += __shfl_down_sync(0xffffffffu, sum, o);
        if (lane == 0) found[i * parts + part] = sum;
    }}
    __syncthreads();
    if (threadIdx.x < count) {{
        double sum = 0.0;
        for (int p = 0; p < parts; ++p) sum += found[threadIdx.x * parts + p];
        out[threadIdx.x] = sum;
    }}
    __syncthreads();
#else
    for (int i = 0; i < count; ++i) {{
        #pragma clang fp reassociate(on)
        const float* row = of + (size_t)i * rows;
        double sum = 0.0;
        for (int r = 0; r < rows; ++r) sum += row[r] * v[r];
        out[i] = sum;
    }}
#endif
"""
_SUM = f"""
    {_AT}
    const double* share = shares.data + (size_t)b * shares.shape[1];
    const double* from = base.data + (size_t)b * rows;
    double* v = vector.data + (size_t)b * rows;
#if defined(__CUDA_ARCH__)
    __syncthreads();
    for (int r = threadIdx.x; r < rows; r += blockDim.x) {{
        double sum = sign * from[r];
        #pragma unroll 8
        for (int i = 0; i < count; ++i) sum += share[i] * of[(size_t)i * rows + r];
        v[r] = sum;
    }}
    __syncthreads();
#else
    for (int r = 0; r < rows; ++r) v[r] = sign * from[r];
    for (int i = 0; i < count; ++i) {{
        const float* row = of + (size_t)i * rows;
        const double c = share[i];
        for (int r = 0; r < rows; ++r) v[r] += c * row[r];
    }}
#endif
"""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def wait_for_all():
    """Let no thread of a block go on before all have come here."""


@wp.func_native(_PRODUCTS)
def products_with(
    ring: wp.array3d(dtype=wp.float32),
    vector: wp.array2d(dtype=wp.float64),
    count: wp.int32,
    b: wp.int32,
    products: wp.array2d(dtype=wp.float64),
):
    """Set an environment's products of the first ``count`` of a ring with its vector."""


@wp.func_native(_SUM)
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


# On a GPU a lane of the first warp has one of the pairs: a loop over them is a triangular solution,
# where every lane takes what the ones before it have found.
_LOOP = """
    const int length = memory.table.shape[1], count = memory.counts.data[b];
    const int start = memory.next.data[b] + length;
    double* t = memory.table.data + (size_t)b * length * length;
    const double* product = memory.products.data + (size_t)b * length;
    double* before = memory.on_gradient.data + (size_t)b * length;
    double* on = memory.along.data + (size_t)b * length;
    double* share = memory.shares.data + (size_t)b * length;
    double* kept = memory.left.data + (size_t)b * length;
"""
_FIRST = f"""
    {_LOOP}
#if defined(__CUDA_ARCH__)
    if (threadIdx.x < 32) {{
        const int lane = threadIdx.x;
        const bool on = lane < count;
        const int at = (start - 1 - (on ? lane : 0)) % length;
        const double inverse = 1.0 / t[at * length + at];
        double sum = -product[at];
        for (int n = 0; n < count; ++n) {{
            const double with = t[at * length + (start - 1 - n) % length];
            const double found = __shfl_sync(0xffffffffu, sum * inverse, n);
            if (lane > n) sum -= found * with;
        }}
        if (on) {{
            kept[at] = sum * inverse;
            share[at] = -sum * inverse;
            before[at] = product[at];
        }}
    }}
    __syncthreads();
#else
    for (int k = 0; k < count; ++k) {{
        const int at = (start - 1 - k) % length;
        double sum = -product[at];
        for (int n = 0; n < k; ++n) {{
            const int other = (start - 1 - n) % length;
            sum -= kept[other] * t[at * length + other];
        }}
        kept[at] = sum / t[at * length + at];
        share[at] = -kept[at];
        before[at] = product[at];
    }}
#endif
"""
_SECOND = f"""
    {_LOOP}
#if defined(__CUDA_ARCH__)
    if (threadIdx.x < 32) {{
        const int lane = threadIdx.x;
        const bool has = lane < count;
        const int at = (start - count + (has ? lane : 0)) % length;
        const double inverse = 1.0 / t[at * length + at], first = kept[at];
        double sum = product[at];
        for (int n = 0; n < count; ++n) {{
            const double with = t[((start - count + n) % length) * length + at];
            const double found = __shfl_sync(0xffffffffu, first - sum * inverse, n);
            if (lane > n) sum += found * with;
        }}
        const double own = first - sum * inverse;
        double total = product[at];
        for (int n = 0; n < count; ++n) {{
            const double with = t[((start - count + n) % length) * length + at];
            total += __shfl_sync(0xffffffffu, own, n) * with;
        }}
        if (has) {{
            share[at] = own;
            on[at] = total;
        }}
    }}
    __syncthreads();
#else
    for (int n = 0; n < count; ++n) {{
        const int at = (start - count + n) % length;
        double sum = product[at];
        for (int m = 0; m < n; ++m) {{
            const int other = (start - count + m) % length;
            sum += share[other] * t[other * length + at];
        }}
        share[at] = kept[at] - sum / t[at * length + at];
    }}
    for (int n = 0; n < count; ++n) {{
        const int at = (start - count + n) % length;
        double total = product[at];
        for (int m = 0; m < count; ++m) {{
            const int other = (start - count + m) % length;
            total += share[other] * t[other * length + at];
        }}
        on[at] = total;
    }}
#endif
"""
_NOTE = f"""
    {_LOOP}
    const int at = (start - 1) % length;
#if defined(__CUDA_ARCH__)
    for (int i = threadIdx.x; i < count; i += blockDim.x)
#else
    for (int i = 0; i < count; ++i)
#endif
    {{
        t[at * length + i] = i == at ? own : fraction * on[i];
        if (i != at) t[i * length + at] = product[i] - before[i];
    }}
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
"""


@wp.func_native(_NOTE)
def note_products(memory: Memory, b: wp.int32, fraction: wp.float64, own: wp.float64):
    """Fill in the table for the newest of an environment.

    ``products`` are those of all s with the new gradient; the step was a fraction of the direction,
    and its own s . y is given [J].
    """


@wp.func_native(_FIRST)
def first_loop(memory: Memory, b: wp.int32):
    """Turn products of all s with the gradient into shares of all y in what the inverse takes."""


@wp.func_native(_SECOND)
def second_loop(memory: Memory, b: wp.int32):
    """Turn products of all y with the inverse's answer into shares of all s in the direction."""
