"""Warp kernels that correct the undeformed gel's inverse for the nodes in contact.

Contact adds a stiffness C at the touching nodes: the stiffness is K = K0 + N C N^T, N picking those
nodes, and Woodbury's identity gives

    K^-1 = K0^-1 - K0^-1 N S^-1 N^T K0^-1,  S = C^-1 + N^T K0^-1 N

so that only the block of K0^-1 at the surface (``compliance``) and a small dense system for every
environment are needed. Nothing in them depends on the indenter, its place or its path. A load adds
the indenter's height: a further unknown, held by a weak spring ``held``, to which every touching
node is tied. One averaged normal for a node instead of three directions takes up to eight times as
many evaluations under a punch's rim.

A block of threads has one environment; on a CPU it is one thread.
"""

# Annotations are evaluated where they stand: those of native functions name a type given below.
import re
from functools import cache
from typing import Any

import warp as wp

from sim.batch.sweep_kernels import BLOCK_OF_THREADS
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


_SHARED = f"""
    {BLOCK_OF_THREADS}
    const int lane = thread % lanes, row = thread / lanes, rows = threads / lanes;
    const int nodes = c.touching.shape[1], capacity = c.listed.shape[1];
    int* listed = c.listed.data + (size_t)b * capacity;
"""
_LIST = f"""
    {_SHARED}
    (void)lane; (void)row; (void)rows;
    // Every thread lists the touching nodes of its part of the surface, in their order.
    SHARED int first[1025];
    const int* touching = c.touching.data + (size_t)b * nodes;
    int* local = c.local.data + (size_t)b * nodes;
    const int part = (nodes + threads - 1) / threads;
    const int from = wp::min(nodes, thread * part), to = wp::min(nodes, from + part);
    int own = 0;
    for (int s = from; s < to; ++s) own += touching[s];
    first[thread + 1] = own;
    SYNC;
    if (thread == 0) {{
        first[0] = 0;
        for (int t = 0; t < threads; ++t) first[t + 1] += first[t];
        c.counts.data[b] = wp::min(first[threads], capacity);
    }}
    SYNC;
    int at = first[thread];
    for (int s = from; s < to; ++s) {{
        local[s] = touching[s] && at < capacity ? at : -1;
        if (local[s] >= 0) listed[at] = s;
        at += touching[s];
    }}
    SYNC;
"""
# Sweeps all pivots of a symmetric matrix (Goodnight 1979), some at a time, which leaves its
# negative inverse. Only what is on and below the diagonal is read: memory bounds it. A warp updates
# two rows at once, and none that the pivots are not coupled with, as most of C's.
_SWEEP = """
    for (int k = 0; k < n; k += WIDE) {
        const int w = wp::min(WIDE, n - k), last = k + WIDE;
        SYNC;
        const int left = wp::min(n, last);
        for (int e = thread; e < WIDE * left; e += threads) {
            const int q = e / left, j = e % left, i = k + q;
            const size_t at = (size_t)wp::max(i, j) * size + wp::min(i, j);
            column[q * PITCH + j] = q < w ? s_at[at] : 0.f;
        }
        for (int e = thread + WIDE * last; e < WIDE * n; e += threads)
            column[e % WIDE * PITCH + e / WIDE] = s_at[(size_t)(e / WIDE) * size + k + e % WIDE];
        SYNC;
        float *now = pivots, *after = pivots + WIDE * WIDE;
        for (int e = thread; e < WIDE * WIDE; e += threads) {
            const int i = e / WIDE, j = e % WIDE;
            now[e] = i < w && j < w ? column[i * PITCH + k + j] : (float)(i == j);
        }
        for (int p = 0; p < WIDE; ++p) {
            SYNC;
            const float over = 1.f / now[p * (WIDE + 1)];
            for (int e = thread; e < WIDE * WIDE; e += threads) {
                const int i = e / WIDE, j = e % WIDE;
                const float a = now[i * WIDE + p], o = now[p * WIDE + j];
                if (i == p) after[e] = j == p ? -over : o * over;
                else after[e] = j == p ? a * over : now[e] - a * over * o;
            }
            float* other = now;
            now = after;
            after = other;
        }
        SYNC;
        // ``now`` is the block's negative inverse.
        for (int e = thread; e < n * WIDE; e += threads) {
            const int i = e / WIDE, j = e % WIDE;
            float sum = 0.f;
            for (int q = 0; q < WIDE; ++q) sum -= column[q * PITCH + i] * now[q * WIDE + j];
            along[e] = sum;
        }
        SYNC;
        for (int i = 2 * row; i < n; i += 2 * rows) {
            float* s_row = s_at + (size_t)i * size;
            float own[2][WIDE];
            bool is_coupled = false;
            #pragma unroll
            for (int q = 0; q < WIDE; ++q) {
                own[0][q] = along[i * WIDE + q];
                own[1][q] = i + 1 < n ? along[(i + 1) * WIDE + q] : 0.f;
                is_coupled = is_coupled || own[0][q] != 0.f || own[1][q] != 0.f;
            }
            if (!is_coupled) continue;
            // Of the first row one number too many, above the diagonal, where none is read.
            const int end = wp::min(i + 1, n - 1), below = i + 1 < n ? size : 0;
            #pragma unroll 2
            for (int j = lane; j <= end; j += lanes) {
                float first = s_row[j], second = s_row[below + j];
                #pragma unroll
                for (int q = 0; q < WIDE; ++q) {
                    const float x = column[q * PITCH + j];
                    first -= own[0][q] * x;
                    second -= own[1][q] * x;
                }
                if (below) s_row[below + j] = second;
                s_row[j] = first;
            }
        }
        SYNC;
        for (int e = thread; e < n * WIDE; e += threads) {
            const int i = e / WIDE, q = e % WIDE;
            const bool inside = i >= k && i < last;
            if (q >= w || (inside && i < k + q)) continue;
            const float x = inside ? now[(i - k) * WIDE + q] : along[e];
            s_at[(size_t)wp::max(i, k + q) * size + wp::min(i, k + q)] = x;
        }
    }
    SYNC;
"""
_FACTOR = f"""
    {_SHARED}
#if defined(__CUDA_ARCH__)
    #define SYNC_WARP __syncwarp()
#else
    #define SYNC_WARP
#endif
    const int count = c.counts.data[b], n = 3 * count, size = c.inverse.shape[1];
    const int* local = c.local.data + (size_t)b * nodes;
    float* s_at = c.inverse.data + (size_t)b * size * size;
    SHARED float column[PITCH * WIDE];
    float* along = c.along.data + (size_t)b * size * WIDE;
    SHARED float pivots[2 * WIDE * WIDE];
    for (int i = row; i < n; i += rows)
        for (int j = lane; j <= i; j += lanes) s_at[(size_t)i * size + j] = 0.f;
    SYNC;
    const int faces = c.faces.shape[0], corners = c.faces.shape[1], points = c.values.shape[0];
    const wp::mat33f* stiffness = c.stiffness.data + (size_t)b * faces * points;
    // A warp has a node's rows and takes its faces in turn: their sum is always the same.
    const int most = c.around.shape[1];
    for (int i = row; i < count; i += rows) {{
        const int* around = c.around.data + (size_t)listed[i] * most;
        for (int t = 0; t < most && around[t] >= 0; ++t) {{
            const int f = around[t] / corners, a = around[t] % corners;
            for (int e = lane; e < 3 * corners; e += lanes) {{
                const int o = e / 3, p = e % 3, other = c.faces.data[f * corners + o];
                const int j = other < 0 ? -1 : local[other];
                if (j < 0 || i < j) continue;
                float sum[3] = {{}};
                for (int q = 0; q < points; ++q) {{
                    const float* own = stiffness[f * points + q].data[p];
                    const float share =
                        c.values.data[q * corners + a] * c.values.data[q * corners + o];
                    for (int k = 0; k < 3; ++k) sum[k] += own[k] * share;
                }}
                float* at = s_at + (size_t)(3 * i + p) * size + 3 * j;
                for (int k = 0; k < 3; ++k) at[k] += sum[k];
            }}
            SYNC_WARP;
        }}
    }}
    SYNC;
    // What a node lacks across its normals, and faces that are touched in part, leave no full rank.
    for (int i = thread; i < count; i += threads) {{
        float trace = 0.f;
        for (int p = 0; p < 3; ++p) trace += s_at[(size_t)(3 * i + p) * (size + 1)];
        for (int p = 0; p < 3; ++p) s_at[(size_t)(3 * i + p) * (size + 1)] += SPARE * trace;
    }}
    {_SWEEP}
    const float share = (float)c.shares.data[b];
    const float tied = pushed ? (float)(1.0 / c.held) : 0.f;
    const size_t wide = 3 * (size_t)nodes;
    for (int i = row; i < n; i += rows) {{
        const float* g = c.compliance.data + (3 * listed[i / 3] + i % 3) * wide;
        for (int j = lane; j <= i; j += lanes) {{
            float sum = share * g[3 * listed[j / 3] + j % 3];
            if (i % 3 == 2 && j % 3 == 2) sum += tied;
            float& own = s_at[(size_t)i * size + j];
            own = sum - own;
        }}
    }}
    {_SWEEP}
    for (int i = row; i < n; i += rows)
        for (int j = lane; j < i; j += lanes)
            s_at[(size_t)j * size + i] = s_at[(size_t)i * size + j];
"""
_CORRECT = f"""
    {_SHARED}
    const int n = 3 * c.counts.data[b], size = c.inverse.shape[1];
    const float* s_at = c.inverse.data + (size_t)b * size * size;
    SHARED float asked[SIZE];
    SHARED float held[SIZE];
    const size_t at = (size_t)slot * given.shape[1];
    const float tip = pushed ? (float)((double)given.data[at + tip_row] / c.held) : 0.f;
    for (int i = thread; i < n; i += threads) {{
        const int r = c.rows.data[3 * listed[i / 3] + i % 3];
        asked[i] = r < 0 ? 0.f : (float)(unit * weights.data[r] * (double)found.data[at + r]);
        if (i % 3 == 2) asked[i] -= tip;
    }}
    SYNC;
    for (int i = row; i < n; i += rows) {{
        float sum = 0.f;
        for (int j = lane; j < n; j += lanes) sum -= s_at[(size_t)i * size + j] * asked[j];
#if defined(__CUDA_ARCH__)
        for (int o = 16; o > 0; o /= 2) sum += __shfl_xor_sync(0xffffffffu, sum, o);
#endif
        if (lane == 0) held[i] = sum;
    }}
    for (int r = thread; r < given.shape[1]; r += threads) out.data[at + r] = given.data[at + r];
    SYNC;
    for (int i = thread; i < n; i += threads) {{
        const int r = c.rows.data[3 * listed[i / 3] + i % 3];
        if (r >= 0)
            out.data[at + r] = KIND((double)out.data[at + r] - (double)(weights.data[r] * held[i]));
    }}
    if (pushed && thread == 0) {{
        double sum = (double)given.data[at + tip_row];
        for (int i = 2; i < n; i += 3) sum += (double)held[i];
        tips.data[b] = sum / c.held / unit;
    }}
    SYNC;
"""


def _filled(snippet: str, *, kind: str = "") -> str:
    numbers = {
        "SIZE": 3 * CAPACITY,
        "PITCH": 3 * CAPACITY + 1,
        "WIDE": WIDE,
        "SPARE": "0.003f",
        "KIND": kind,
    }
    for name, value in numbers.items():
        snippet = re.sub(rf"\b{name}\b", str(value), snippet)
    return snippet


@wp.func_native(_filled(_LIST))
def _list_touching(c: Correction, b: wp.int32): ...


@wp.func_native(_filled(_FACTOR))
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

    @wp.func_native(_filled(_CORRECT, kind=name))
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
