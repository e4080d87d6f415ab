// Threads of a block along the rows and along the columns of a tile.
#define SIDE 16

// Entry `i` of the `N` rows or columns of a thread, as a row or column of the tile.
template <int N>
FUNCTION int own_place(const int i, const int at) {
    const int group = N < 4 ? N : 4;
    return (i / group * SIDE + at) * group + i % group;
}

// A step brings `DEPTH` values of `k` of `SIZE` rows of the first factor, or columns of the second. Each thread fetches
// its part; `is_along` says that values of `k` lie side by side in memory.
template <int SIZE>
FUNCTION void fetch(float (&next)[SIZE * DEPTH / THREADS], const float *x, const bool is_along, const int first,
                    const int size, const int inner, const int step, const int thread) {
    UNROLL for (int e = 0; e < SIZE * DEPTH / THREADS; e++) {
        const int at = e * THREADS + thread;
        const int k = step * DEPTH + (is_along ? at % DEPTH : at / SIZE);
        const int place = first + (is_along ? at / DEPTH : at % SIZE);
        next[e] = k < inner && place < size ? x[is_along ? place * inner + k : k * size + place] : 0.0f;
    }
}

// Puts the part of a thread where the block reads it.
template <int SIZE>
FUNCTION void put(float *tile, const float (&next)[SIZE * DEPTH / THREADS], const bool is_along, const int thread) {
    UNROLL for (int e = 0; e < SIZE * DEPTH / THREADS; e++) {
        const int at = e * THREADS + thread;
        tile[(is_along ? at % DEPTH : at / SIZE) * (SIZE + 4) + (is_along ? at / DEPTH : at % SIZE)] = next[e];
    }
}

// Lengthens the chains of a thread by one value of `k`.
template <int ROWS, int COLUMNS>
FUNCTION void lengthen(float (&chain)[ROWS / SIDE][COLUMNS / SIDE], const float *of_a, const float *of_b, const int thread) {
    float a[ROWS / SIDE], b[COLUMNS / SIDE];
    UNROLL for (int i = 0; i < ROWS / SIDE; i++) a[i] = of_a[own_place<ROWS / SIDE>(i, thread / SIDE)];
    UNROLL for (int j = 0; j < COLUMNS / SIDE; j++) b[j] = of_b[own_place<COLUMNS / SIDE>(j, thread % SIDE)];
    UNROLL for (int i = 0; i < ROWS / SIDE; i++)
        UNROLL for (int j = 0; j < COLUMNS / SIDE; j++) chain[i][j] = fmaf(a[i], b[j], chain[i][j]);
}

// A tile `[ROWS, COLUMNS]` of the product of `a` [rows, inner] and `b` [inner, columns], each of which may lie in memory
// with rows and columns exchanged. While a block works on one step, it fetches the next.
template <int ROWS, int COLUMNS>
FUNCTION void product(const float *a, const float *b, float *c, const float *bias, const int activation, const int rows,
                      const int columns, const int inner, const bool a_turned, const bool b_turned, const int block) {
    float chain[KEPT][ROWS / SIDE][COLUMNS / SIDE], sum[KEPT][ROWS / SIDE][COLUMNS / SIDE];
    float next_a[KEPT][ROWS * DEPTH / THREADS], next_b[KEPT][COLUMNS * DEPTH / THREADS];
    const int stride_a = ROWS + 4, stride_b = COLUMNS + 4;
    float *const tiles_a = shared, *const tiles_b = shared + 2 * DEPTH * stride_a;
    const int across = (columns + COLUMNS - 1) / COLUMNS;
    const int first_row = block / across * ROWS, first_column = block % across * COLUMNS;
    const int steps = (inner + DEPTH - 1) / DEPTH;
    EACH_THREAD {
        fetch<ROWS>(next_a[own], a, !a_turned, first_row, rows, inner, 0, thread);
        fetch<COLUMNS>(next_b[own], b, b_turned, first_column, columns, inner, 0, thread);
        put<ROWS>(tiles_a, next_a[own], !a_turned, thread);
        put<COLUMNS>(tiles_b, next_b[own], b_turned, thread);
    }
    WAIT;
    for (int first = 0; first < steps; first += CHAIN / DEPTH) {
        EACH_THREAD {
            UNROLL for (int i = 0; i < ROWS / SIDE; i++)
                UNROLL for (int j = 0; j < COLUMNS / SIDE; j++) chain[own][i][j] = 0.0f;
        }
        const int end = first + CHAIN / DEPTH < steps ? first + CHAIN / DEPTH : steps;
        for (int step = first; step < end; step++) {
            EACH_THREAD {
                const float *const tile_a = tiles_a + (step & 1) * DEPTH * stride_a;
                const float *const tile_b = tiles_b + (step & 1) * DEPTH * stride_b;
                const int after = step + 1;
                if (after < steps) {
                    fetch<ROWS>(next_a[own], a, !a_turned, first_row, rows, inner, after, thread);
                    fetch<COLUMNS>(next_b[own], b, b_turned, first_column, columns, inner, after, thread);
                }
                if (inner - step * DEPTH >= DEPTH) {
                    UNROLL for (int k = 0; k < DEPTH; k++)
                        lengthen<ROWS, COLUMNS>(chain[own], tile_a + k * stride_a, tile_b + k * stride_b, thread);
                } else {
                    for (int k = 0; k < inner - step * DEPTH; k++)
                        lengthen<ROWS, COLUMNS>(chain[own], tile_a + k * stride_a, tile_b + k * stride_b, thread);
                }
                if (after < steps) {
                    put<ROWS>(tiles_a + (after & 1) * DEPTH * stride_a, next_a[own], !a_turned, thread);
                    put<COLUMNS>(tiles_b + (after & 1) * DEPTH * stride_b, next_b[own], b_turned, thread);
                }
            }
            WAIT;
        }
        EACH_THREAD {
            UNROLL for (int i = 0; i < ROWS / SIDE; i++)
                UNROLL for (int j = 0; j < COLUMNS / SIDE; j++)
                    sum[own][i][j] = first == 0 ? chain[own][i][j] : sum[own][i][j] + chain[own][i][j];
        }
    }
    EACH_THREAD {
        UNROLL for (int i = 0; i < ROWS / SIDE; i++) {
            const int row = first_row + own_place<ROWS / SIDE>(i, thread / SIDE);
            UNROLL for (int j = 0; j < COLUMNS / SIDE; j++) {
                const int column = first_column + own_place<COLUMNS / SIDE>(j, thread % SIDE);
                if (row >= rows || column >= columns) continue;
                const float x = bias ? sum[own][i][j] + bias[column] : sum[own][i][j];
                c[row * columns + column] = activated(activation, x);
            }
        }
    }
}
