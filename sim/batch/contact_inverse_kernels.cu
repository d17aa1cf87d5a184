// snippet shared
// include block_of_threads
const int lane = thread % lanes, row = thread / lanes, rows = threads / lanes;
const int nodes = c.touching.shape[1], capacity = c.listed.shape[1];
int* listed = c.listed.data + (size_t)b * capacity;

// snippet list
// include shared
(void)row; (void)rows;
// Every thread lists the touching nodes of its part of the surface, in their order.
const int* touching = c.touching.data + (size_t)b * nodes;
int* local = c.local.data + (size_t)b * nodes;
const int part = (nodes + threads - 1) / threads;
const int from = wp::min(nodes, thread * part), to = wp::min(nodes, from + part);
int at = 0;
for (int s = from; s < to; ++s) at += touching[s];
int all = at;
#if defined(__CUDA_ARCH__)
// Sums over the threads before: first those of a warp, then those of all.
__shared__ int warps[32];
const int own = at;
for (int o = 1; o < 32; o *= 2) {
    const int before = __shfl_up_sync(0xffffffffu, at, o);
    if (lane >= o) at += before;
}
if (lane == 31) warps[thread / 32] = at;
__syncthreads();
at -= own;
all = 0;
for (int w = 0; w < threads / 32; ++w) {
    if (w < thread / 32) at += warps[w];
    all += warps[w];
}
#else
(void)lane;
at = 0;
#endif
if (thread == 0) c.counts.data[b] = wp::min(all, capacity);
for (int s = from; s < to; ++s) {
    local[s] = touching[s] && at < capacity ? at : -1;
    if (local[s] >= 0) listed[at] = s;
    at += touching[s];
}
SYNC;

// snippet sweep
// Sweeps all pivots of a symmetric matrix (Goodnight 1979), some at a time, which leaves its
// negative inverse. Only what is on and below the diagonal is read: memory bounds it. A warp updates
// two rows at once, and none that the pivots are not coupled with, as most of C's.
for (int k = 0; k < n; k += WIDE) {
    const int w = wp::min(WIDE, n - k), last = k + WIDE;
    SYNC;
    const int left = wp::min(n, last);
    for (int e = thread; e < WIDE * left; e += threads) {
        const int q = e / left, j = e % left, i = k + q;
        column[q * pitch + j] = q < w ? s_at[begin(wp::max(i, j)) + wp::min(i, j)] : 0.f;
    }
    for (int e = thread + WIDE * last; e < WIDE * n; e += threads)
        column[e % WIDE * pitch + e / WIDE] = s_at[begin(e / WIDE) + k + e % WIDE];
    SYNC;
    // One warp has the pivots: it need not wait for the others.
    if (row == 0) {
        float *now = pivots, *after = pivots + WIDE * WIDE;
        for (int e = lane; e < WIDE * WIDE; e += lanes) {
            const int i = e / WIDE, j = e % WIDE;
            now[e] = i < w && j < w ? column[i * pitch + k + j] : (float)(i == j);
        }
        for (int p = 0; p < WIDE; ++p) {
            SYNC_WARP;
            const float over = 1.f / now[p * (WIDE + 1)];
            #pragma unroll
            for (int e = lane; e < WIDE * WIDE; e += lanes) {
                const int i = e / WIDE, j = e % WIDE;
                const float a = now[i * WIDE + p], o = now[p * WIDE + j];
                if (i == p) after[e] = j == p ? -over : o * over;
                else after[e] = j == p ? a * over : now[e] - a * over * o;
            }
            float* other = now;
            now = after;
            after = other;
        }
    }
    SYNC;
    // After an even number of pivots ``pivots`` begins with the block's negative inverse. A thread
    // makes four neighbours, which share what they are made of.
    for (int e = thread; e < n * (WIDE / 4); e += threads) {
        const int i = e / (WIDE / 4), j = e % (WIDE / 4) * 4;
        float sum[4] = {};
        #pragma unroll
        for (int q = 0; q < WIDE; ++q) {
            const float x = column[q * pitch + i];
            #pragma unroll
            for (int m = 0; m < 4; ++m) sum[m] -= x * pivots[q * WIDE + j + m];
        }
        #pragma unroll
        for (int m = 0; m < 4; ++m) along[i * WIDE + j + m] = sum[m];
    }
    SYNC;
    for (int i = 2 * row; i < n; i += 2 * rows) {
        const bool is_last = i + 1 == n;
        float* s_row = s_at + begin(i);
        float* s_next = is_last ? s_row : s_at + begin(i + 1);
        float own[2][WIDE];
        bool is_coupled = false;
        #pragma unroll
        for (int q = 0; q < WIDE; ++q) {
            own[0][q] = along[i * WIDE + q];
            own[1][q] = is_last ? 0.f : along[(i + 1) * WIDE + q];
            is_coupled = is_coupled || own[0][q] != 0.f || own[1][q] != 0.f;
        }
        if (!is_coupled) continue;
        #pragma unroll 2
        for (int j = lane; j <= wp::min(i + 1, n - 1); j += lanes) {
            float first = s_row[j], second = s_next[j];
            #pragma unroll
            for (int q = 0; q < WIDE; ++q) {
                const float x = column[q * pitch + j];
                first -= own[0][q] * x;
                second -= own[1][q] * x;
            }
            if (!is_last) s_next[j] = second;
            if (j <= i) s_row[j] = first;
        }
    }
    SYNC;
    for (int e = thread; e < n * WIDE; e += threads) {
        const int i = e / WIDE, q = e % WIDE;
        const bool inside = i >= k && i < last;
        if (q >= w || (inside && i < k + q)) continue;
        const float x = inside ? pivots[(i - k) * WIDE + q] : along[e];
        s_at[begin(wp::max(i, k + q)) + wp::min(i, k + q)] = x;
    }
}
SYNC;

// snippet factor
// include shared
#if defined(__CUDA_ARCH__)
#define SYNC_WARP __syncwarp()
#else
#define SYNC_WARP
#endif
const int count = c.counts.data[b], n = 3 * count, size = c.inverse.shape[1];
const int* local = c.local.data + (size_t)b * nodes;
float* inverse = c.inverse.data + (size_t)b * size * size;
SHARED float pivots[2 * WIDE * WIDE];
// A small system fits into the memory that a block shares, row after row up to the diagonal.
constexpr int small = 120;
SHARED float column[WIDE * (2 * small + 2) + small * (small + 1) / 2];
static_assert(sizeof(column) >= sizeof(float) * PITCH * WIDE, "a large system needs as much");
if (n <= small) {
    constexpr int pitch = small + 2;
    float *along = column + WIDE * pitch, *s_at = along + WIDE * small;
    const auto begin = [](int i) { return i * (i + 1) / 2; };
    // include system
} else {
    constexpr int pitch = PITCH;
    float *along = c.along.data + (size_t)b * size * WIDE, *s_at = inverse;
    const auto begin = [size](int i) { return (size_t)i * size; };
    // include system
}

// snippet system
for (int i = row; i < n; i += rows)
    for (int j = lane; j <= i; j += lanes) s_at[begin(i) + j] = 0.f;
SYNC;
const int faces = c.faces.shape[0], corners = c.faces.shape[1], points = c.values.shape[0];
const wp::mat33f* stiffness = c.stiffness.data + (size_t)b * faces * points;
// A warp has a node's rows and takes its faces in turn: their sum is always the same.
const int most = c.around.shape[1];
for (int i = row; i < count; i += rows) {
    const int* around = c.around.data + (size_t)listed[i] * most;
    for (int t = 0; t < most && around[t] >= 0; ++t) {
        const int f = around[t] / corners, a = around[t] % corners;
        for (int e = lane; e < 3 * corners; e += lanes) {
            const int o = e / 3, p = e % 3, other = c.faces.data[f * corners + o];
            const int j = other < 0 ? -1 : local[other];
            if (j < 0 || i < j) continue;
            float sum[3] = {};
            for (int q = 0; q < points; ++q) {
                const float* own = stiffness[f * points + q].data[p];
                const float share =
                    c.values.data[q * corners + a] * c.values.data[q * corners + o];
                for (int k = 0; k < 3; ++k) sum[k] += own[k] * share;
            }
            // Of a node's own block what is above the diagonal is not kept.
            for (int k = 0; k < 3 && 3 * j + k <= 3 * i + p; ++k)
                s_at[begin(3 * i + p) + 3 * j + k] += sum[k];
        }
        SYNC_WARP;
    }
}
SYNC;
// What a node lacks across its normals, and faces that are touched in part, leave no full rank.
for (int i = thread; i < count; i += threads) {
    float trace = 0.f;
    for (int p = 0; p < 3; ++p) trace += s_at[begin(3 * i + p) + 3 * i + p];
    for (int p = 0; p < 3; ++p) s_at[begin(3 * i + p) + 3 * i + p] += 0.003f * trace;
}
// include sweep
const float share = (float)c.shares.data[b];
const float tied = pushed ? (float)(1.0 / c.held) : 0.f;
const size_t wide = 3 * (size_t)nodes;
for (int i = row; i < n; i += rows) {
    const float* g = c.compliance.data + (3 * listed[i / 3] + i % 3) * wide;
    for (int j = lane; j <= i; j += lanes) {
        float sum = share * g[3 * listed[j / 3] + j % 3];
        if (i % 3 == 2 && j % 3 == 2) sum += tied;
        float& own = s_at[begin(i) + j];
        own = sum - own;
    }
}
// include sweep
for (int i = row; i < n; i += rows)
    for (int j = lane; j <= i; j += lanes) {
        const float x = s_at[begin(i) + j];
        inverse[(size_t)i * size + j] = x;
        inverse[(size_t)j * size + i] = x;
    }

// snippet correct
// include shared
const int n = 3 * c.counts.data[b], size = c.inverse.shape[1];
const float* s_at = c.inverse.data + (size_t)b * size * size;
SHARED float asked[SIZE];
SHARED float held[SIZE];
const size_t at = (size_t)slot * given.shape[1];
const float tip = pushed ? (float)((double)given.data[at + tip_row] / c.held) : 0.f;
for (int i = thread; i < n; i += threads) {
    const int r = c.rows.data[3 * listed[i / 3] + i % 3];
    asked[i] = r < 0 ? 0.f : (float)(unit * weights.data[r] * (double)found.data[at + r]);
    if (i % 3 == 2) asked[i] -= tip;
}
SYNC;
for (int i = row; i < n; i += rows) {
    float sum = 0.f;
    for (int j = lane; j < n; j += lanes) sum -= s_at[(size_t)i * size + j] * asked[j];
#if defined(__CUDA_ARCH__)
    for (int o = 16; o > 0; o /= 2) sum += __shfl_xor_sync(0xffffffffu, sum, o);
#endif
    if (lane == 0) held[i] = sum;
}
for (int r = thread; r < given.shape[1]; r += threads) out.data[at + r] = given.data[at + r];
SYNC;
for (int i = thread; i < n; i += threads) {
    const int r = c.rows.data[3 * listed[i / 3] + i % 3];
    if (r >= 0)
        out.data[at + r] = KIND((double)out.data[at + r] - (double)(weights.data[r] * held[i]));
}
if (pushed && thread == 0) {
    double sum = (double)given.data[at + tip_row];
    for (int i = 2; i < n; i += 3) sum += (double)held[i];
    tips.data[b] = sum / c.held / unit;
}
SYNC;
