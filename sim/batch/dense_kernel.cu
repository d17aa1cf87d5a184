// snippet product
// One block makes a block of the product. Its warps share out rows, columns and, in DEPTH_WARPS
// groups, the terms of the sums, which are then added in shared memory. Fragments are those of the
// PTX manual's mma.m16n8k16 of .f16. Which term is which does not matter to a sum as long as both
// factors agree: a lane takes eight neighbouring terms of a vector, and the matrix is packed so that
// its lane's parts of the two fragments that go with them are a uint4 each.
const int row_block = block % row_blocks, column_block = block / row_blocks;
const int matrix = which.data[column_block];
if (matrix < 0) return;
const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
const int group = lane >> 2, member = lane & 3;
const int row_warp = warp % ROW_WARPS, column_warp = warp / ROW_WARPS % COLUMN_WARPS;
const int part = warp / (ROW_WARPS * COLUMN_WARPS);
const int rows = right.shape[1], steps = rows / 32;
const int first_row = row_block * TILE_ROWS;
const int first_column = column_block * TILE_COLUMNS;
const int rows_before = 16 * ROW_TILES * row_warp;
const int columns_before = 8 * COLUMN_TILES * column_warp;
const uint4* packed = (const uint4*)matrices.data + lane;
packed += (size_t)(matrix * (rows / 16) + (first_row + rows_before) / 16) * steps * 64;
const uint4* vectors = (const uint4*)right.data + member;
vectors += (size_t)(first_column + columns_before + group) * (rows / 8);
float sum[ROW_TILES][COLUMN_TILES][4];
#pragma unroll
for (int i = 0; i < ROW_TILES; ++i)
    #pragma unroll
    for (int j = 0; j < COLUMN_TILES; ++j)
        #pragma unroll
        for (int k = 0; k < 4; ++k) sum[i][j][k] = 0.f;
#pragma unroll 2
for (int s = part; s < steps; s += DEPTH_WARPS) {
    uint4 a[2][ROW_TILES], b[COLUMN_TILES];
    #pragma unroll
    for (int j = 0; j < COLUMN_TILES; ++j) b[j] = vectors[(size_t)j * rows + 4 * s];
    #pragma unroll
    for (int h = 0; h < 2; ++h)
        #pragma unroll
        for (int i = 0; i < ROW_TILES; ++i)
            a[h][i] = packed[((size_t)i * steps + s) * 64 + 32 * h];
    #pragma unroll
    for (int h = 0; h < 2; ++h)
        #pragma unroll
        for (int j = 0; j < COLUMN_TILES; ++j)
            #pragma unroll
            for (int i = 0; i < ROW_TILES; ++i) {
                float* c = sum[i][j];
                asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 "
                    "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
                    : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
                    : "r"(a[h][i].x), "r"(a[h][i].y), "r"(a[h][i].z), "r"(a[h][i].w),
                      "r"(h ? b[j].z : b[j].x), "r"(h ? b[j].w : b[j].y));
            }
}
__shared__ float total[SHARED];
float* out_at = out.data + (size_t)first_column * rows;
const int* to = order.data + first_row;
for (int round = 0; round < DEPTH_WARPS; ++round) {
    if (part == round) {
        #pragma unroll
        for (int i = 0; i < ROW_TILES; ++i)
            #pragma unroll
            for (int j = 0; j < COLUMN_TILES; ++j)
                #pragma unroll
                for (int k = 0; k < 4; ++k) {
                    const int row = rows_before + 16 * i + group + 8 * (k / 2);
                    const int column = columns_before + 8 * j + 2 * member + k % 2;
                    if (DEPTH_WARPS == 1)
                        out_at[(size_t)column * rows + to[row]] = sum[i][j][k];
                    else if (round == 0)
                        total[column * (TILE_ROWS + 4) + row] = sum[i][j][k];
                    else
                        total[column * (TILE_ROWS + 4) + row] += sum[i][j][k];
                }
    }
    if (DEPTH_WARPS > 1) __syncthreads();
}
if (DEPTH_WARPS > 1)
    for (int k = threadIdx.x; k < TILE_ROWS * TILE_COLUMNS; k += blockDim.x) {
        const int row = k % TILE_ROWS, column = k / TILE_ROWS;
        out_at[(size_t)column * rows + to[row]] = total[column * (TILE_ROWS + 4) + row];
    }
