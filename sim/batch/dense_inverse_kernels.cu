// snippet block_of_threads
// SHARED and SYNC let one code serve a block of threads and the one thread of a CPU.
#if defined(__CUDA_ARCH__)
#define SHARED __shared__ __align__(16)
#define SYNC __syncthreads()
const int thread = threadIdx.x, threads = blockDim.x, lanes = 32;
#else
#define SHARED
#define SYNC
const int thread = 0, threads = 1, lanes = 1;
#endif

// snippet invert
// include block_of_threads
SHARED double a[BLOCK * BLOCK];
SHARED double column[BLOCK];
const size_t wide = matrix.shape[1], at = (size_t)k * BLOCK;
for (int e = thread; e < BLOCK * BLOCK; e += threads)
    a[e] = matrix.data[(at + e / BLOCK) * wide + at + e % BLOCK];
for (int p = 0; p < BLOCK; ++p) {
    SYNC;
    for (int i = thread; i < BLOCK; i += threads) column[i] = a[i * BLOCK + p];
    SYNC;
    const double over = 1.0 / column[p];
    for (int e = thread; e < BLOCK * BLOCK; e += threads) {
        const int i = e / BLOCK, j = e % BLOCK;
        if (i == p) a[e] = j == p ? -over : column[j] * over;
        else a[e] = j == p ? column[i] * over : a[e] - column[i] * over * column[j];
    }
}
SYNC;
for (int e = thread; e < BLOCK * BLOCK; e += threads) out.data[e] = (float)-a[e];
SYNC;

// snippet tiles
// Take the product of one tile's transpose with another tile off a third, or, where sign is 0, set
// that to it. A thread has 64 entries, in four squares that neighbours read side by side.
// include block_of_threads
SHARED float l[BLOCK * BLOCK];
SHARED float r[BLOCK * BLOCK];
const size_t lefts = left.shape[1], rights = right.shape[1], wide = out.shape[1];
SYNC;
for (int e = thread; e < BLOCK * BLOCK; e += threads) {
    l[e] = left.data[(e / BLOCK) * lefts + left_column + e % BLOCK];
    r[e] = right.data[(e / BLOCK) * rights + right_column + e % BLOCK];
}
SYNC;
for (int e = thread; e < BLOCK * BLOCK / 64; e += threads) {
    const int y = e / (BLOCK / 8) * 4, x = e % (BLOCK / 8) * 4;
    float sum[8][8] = {};
    #pragma unroll 4
    for (int p = 0; p < BLOCK; ++p) {
        float a[8], b[8];
        #pragma unroll
        for (int u = 0; u < 8; ++u) {
            a[u] = l[p * BLOCK + y + u / 4 * (BLOCK / 2) + u % 4];
            b[u] = r[p * BLOCK + x + u / 4 * (BLOCK / 2) + u % 4];
        }
        #pragma unroll
        for (int u = 0; u < 8; ++u)
            #pragma unroll
            for (int v = 0; v < 8; ++v) sum[u][v] += a[u] * b[v];
    }
    #pragma unroll
    for (int u = 0; u < 8; ++u)
        #pragma unroll
        for (int v = 0; v < 8; ++v) {
            const int row = y + u / 4 * (BLOCK / 2) + u % 4;
            const int column = x + v / 4 * (BLOCK / 2) + v % 4;
            float& own = out.data[(out_row + row) * wide + out_column + column];
            own = sign == 0.f ? sum[u][v] : own - sum[u][v];
        }
}
SYNC;
