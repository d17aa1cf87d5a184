// snippet block_of_threads
// SHARED and SYNC let one code serve a block of threads and the one thread of a CPU.
#if defined(__CUDA_ARCH__)
#define SHARED __shared__
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
// Of two tiles the product of one with the other's transpose; a thread has 16 entries of it.
// include block_of_threads
SHARED float l[BLOCK * (BLOCK + 1)];
SHARED float r[BLOCK * (BLOCK + 1)];
const size_t lefts = left.shape[1], rights = right.shape[1], wide = out.shape[1];
for (int e = thread; e < BLOCK * BLOCK; e += threads) {
    const int i = e / BLOCK, j = e % BLOCK;
    l[i * (BLOCK + 1) + j] = left.data[(left_row + i) * lefts + left_column + j];
    r[i * (BLOCK + 1) + j] = right.data[(right_row + i) * rights + j];
}
SYNC;
for (int e = thread; e < BLOCK * BLOCK / 16; e += threads) {
    const int y = e / (BLOCK / 4) * 4, x = e % (BLOCK / 4);
    float sum[4][4] = {};
    for (int p = 0; p < BLOCK; ++p)
        for (int u = 0; u < 4; ++u)
            for (int v = 0; v < 4; ++v)
                sum[u][v] += l[(y + u) * (BLOCK + 1) + p]
                    * r[(x + BLOCK / 4 * v) * (BLOCK + 1) + p];
    for (int u = 0; u < 4; ++u)
        for (int v = 0; v < 4; ++v) {
            float& own = out.data[(out_row + y + u) * wide + out_column + x + BLOCK / 4 * v];
            own = sign * own + sum[u][v] * (sign == 0.f ? 1.f : -1.f);
        }
}
SYNC;
