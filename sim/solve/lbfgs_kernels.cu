// snippet at
const int rows = ring.shape[2];
const float* of = ring.data + (size_t)b * ring.shape[1] * rows;

// snippet products
// Sums may be taken in any order, so that the processor takes several terms at once.
// include at
const double* v = vector.data + (size_t)b * rows;
double* out = products.data + (size_t)b * products.shape[1];
#if defined(__CUDA_ARCH__)
// Few products are shared out, so that every warp has a part of one.
__shared__ double found[32];
const int lane = threadIdx.x & 31, warps = blockDim.x >> 5;
const int parts = max(1, warps / max(1, count));
const int part = (threadIdx.x >> 5) % parts;
for (int i = (threadIdx.x >> 5) / parts; i < count; i += max(1, warps / parts)) {
    double sum = 0.0;
    #pragma unroll 8
    for (int r = lane + 32 * part; r < rows; r += 32 * parts)
        sum += of[(size_t)i * rows + r] * v[r];
    for (int o = 16; o > 0; o >>= 1) sum += __shfl_down_sync(0xffffffffu, sum, o);
    if (lane == 0) found[i * parts + part] = sum;
}
__syncthreads();
if (threadIdx.x < count) {
    double sum = 0.0;
    for (int p = 0; p < parts; ++p) sum += found[threadIdx.x * parts + p];
    out[threadIdx.x] = sum;
}
__syncthreads();
#else
for (int i = 0; i < count; ++i) {
    #pragma clang fp reassociate(on)
    const float* row = of + (size_t)i * rows;
    double sum = 0.0;
    for (int r = 0; r < rows; ++r) sum += row[r] * v[r];
    out[i] = sum;
}
#endif

// snippet sum
// include at
const double* share = shares.data + (size_t)b * shares.shape[1];
const double* from = base.data + (size_t)b * rows;
double* v = vector.data + (size_t)b * rows;
#if defined(__CUDA_ARCH__)
__syncthreads();
for (int r = threadIdx.x; r < rows; r += blockDim.x) {
    double sum = sign * from[r];
    #pragma unroll 8
    for (int i = 0; i < count; ++i) sum += share[i] * of[(size_t)i * rows + r];
    v[r] = sum;
}
__syncthreads();
#else
for (int r = 0; r < rows; ++r) v[r] = sign * from[r];
for (int i = 0; i < count; ++i) {
    const float* row = of + (size_t)i * rows;
    const double c = share[i];
    for (int r = 0; r < rows; ++r) v[r] += c * row[r];
}
#endif

// snippet loop
// On a GPU a lane of the first warp has one of the pairs: a loop over them is a triangular solution,
// where every lane takes what the ones before it have found.
const int length = memory.table.shape[1], count = memory.counts.data[b];
const int start = memory.next.data[b] + length;
double* t = memory.table.data + (size_t)b * length * length;
const double* product = memory.products.data + (size_t)b * length;
double* before = memory.on_gradient.data + (size_t)b * length;
double* on = memory.along.data + (size_t)b * length;
double* share = memory.shares.data + (size_t)b * length;
double* kept = memory.left.data + (size_t)b * length;

// snippet first
// include loop
#if defined(__CUDA_ARCH__)
if (threadIdx.x < 32) {
    const int lane = threadIdx.x;
    const bool on = lane < count;
    const int at = (start - 1 - (on ? lane : 0)) % length;
    const double inverse = 1.0 / t[at * length + at];
    double sum = -product[at];
    for (int n = 0; n < count; ++n) {
        const double with = t[at * length + (start - 1 - n) % length];
        const double found = __shfl_sync(0xffffffffu, sum * inverse, n);
        if (lane > n) sum -= found * with;
    }
    if (on) {
        kept[at] = sum * inverse;
        share[at] = -sum * inverse;
        before[at] = product[at];
    }
}
__syncthreads();
#else
for (int k = 0; k < count; ++k) {
    const int at = (start - 1 - k) % length;
    double sum = -product[at];
    for (int n = 0; n < k; ++n) {
        const int other = (start - 1 - n) % length;
        sum -= kept[other] * t[at * length + other];
    }
    kept[at] = sum / t[at * length + at];
    share[at] = -kept[at];
    before[at] = product[at];
}
#endif

// snippet second
// include loop
#if defined(__CUDA_ARCH__)
if (threadIdx.x < 32) {
    const int lane = threadIdx.x;
    const bool has = lane < count;
    const int at = (start - count + (has ? lane : 0)) % length;
    const double inverse = 1.0 / t[at * length + at], first = kept[at];
    double sum = product[at];
    for (int n = 0; n < count; ++n) {
        const double with = t[((start - count + n) % length) * length + at];
        const double found = __shfl_sync(0xffffffffu, first - sum * inverse, n);
        if (lane > n) sum += found * with;
    }
    const double own = first - sum * inverse;
    double total = product[at];
    for (int n = 0; n < count; ++n) {
        const double with = t[((start - count + n) % length) * length + at];
        total += __shfl_sync(0xffffffffu, own, n) * with;
    }
    if (has) {
        share[at] = own;
        on[at] = total;
    }
}
__syncthreads();
#else
for (int n = 0; n < count; ++n) {
    const int at = (start - count + n) % length;
    double sum = product[at];
    for (int m = 0; m < n; ++m) {
        const int other = (start - count + m) % length;
        sum += share[other] * t[other * length + at];
    }
    share[at] = kept[at] - sum / t[at * length + at];
}
for (int n = 0; n < count; ++n) {
    const int at = (start - count + n) % length;
    double total = product[at];
    for (int m = 0; m < count; ++m) {
        const int other = (start - count + m) % length;
        total += share[other] * t[other * length + at];
    }
    on[at] = total;
}
#endif

// snippet note
// include loop
const int at = (start - 1) % length;
#if defined(__CUDA_ARCH__)
for (int i = threadIdx.x; i < count; i += blockDim.x)
#else
for (int i = 0; i < count; ++i)
#endif
{
    t[at * length + i] = i == at ? own : fraction * on[i];
    if (i != at) t[i * length + at] = product[i] - before[i];
}
#if defined(__CUDA_ARCH__)
__syncthreads();
#endif
