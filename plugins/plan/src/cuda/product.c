// A tile `[TILE_ROWS, TILE_COLUMNS]` of the product of `a` [rows, inner] and `b` [inner, columns], each of which may
// lie in memory with rows and columns exchanged. A thread keeps the chains of `TILE_ROWS / TALL * TILE_COLUMNS / WIDE`
// entries, `TALL * WIDE = THREADS`. While a block works on one step of `DEPTH` values of `k`, it fetches the next.
#define OWN_ROWS (TILE_ROWS / TALL)
#define OWN_COLUMNS (TILE_COLUMNS / WIDE)
#define GROUP_ROWS (OWN_ROWS < 4 ? OWN_ROWS : 4)
#define GROUP_COLUMNS (OWN_COLUMNS < 4 ? OWN_COLUMNS : 4)
#define OWN_ROW(i) (((i) / GROUP_ROWS * TALL + thread / WIDE) * GROUP_ROWS + (i) % GROUP_ROWS)
#define OWN_COLUMN(j) (((j) / GROUP_COLUMNS * WIDE + thread % WIDE) * GROUP_COLUMNS + (j) % GROUP_COLUMNS)
#define FETCHED_A (TILE_ROWS * DEPTH / THREADS)
#define FETCHED_B (TILE_COLUMNS * DEPTH / THREADS)
#define STRIDE_A (TILE_ROWS + 4)
#define STRIDE_B (TILE_COLUMNS + 4)

// Entry `at` of a step's part of a factor: its value of `k`, and its row or column.
#define FETCHED_K(at, is_along, size) ((is_along) ? (at) % DEPTH : (at) / (size))
#define FETCHED_PLACE(at, is_along, size) ((is_along) ? (at) / DEPTH : (at) % (size))

#define FETCH(step)                                                                                            \
    UNROLL for (int e = 0; e < FETCHED_A; e++) {                                                               \
        const int at = e * THREADS + thread;                                                                   \
        const int k = (step) * DEPTH + FETCHED_K(at, !a_turned, TILE_ROWS);                                    \
        const int row = first_row + FETCHED_PLACE(at, !a_turned, TILE_ROWS);                                   \
        next_a[own][e] = k < inner && row < rows ? a[a_turned ? k * rows + row : row * inner + k] : 0.0f;      \
    }                                                                                                          \
    UNROLL for (int e = 0; e < FETCHED_B; e++) {                                                               \
        const int at = e * THREADS + thread;                                                                   \
        const int k = (step) * DEPTH + FETCHED_K(at, b_turned, TILE_COLUMNS);                                  \
        const int column = first_column + FETCHED_PLACE(at, b_turned, TILE_COLUMNS);                           \
        next_b[own][e] =                                                                                       \
            k < inner && column < columns ? b[b_turned ? column * inner + k : k * columns + column] : 0.0f;    \
    }

#define PUT(step)                                                                                              \
    UNROLL for (int e = 0; e < FETCHED_A; e++) {                                                               \
        const int at = e * THREADS + thread;                                                                   \
        tiles_a[((step) & 1) * DEPTH * STRIDE_A + FETCHED_K(at, !a_turned, TILE_ROWS) * STRIDE_A +             \
                FETCHED_PLACE(at, !a_turned, TILE_ROWS)] = next_a[own][e];                                     \
    }                                                                                                          \
    UNROLL for (int e = 0; e < FETCHED_B; e++) {                                                               \
        const int at = e * THREADS + thread;                                                                   \
        tiles_b[((step) & 1) * DEPTH * STRIDE_B + FETCHED_K(at, b_turned, TILE_COLUMNS) * STRIDE_B +           \
                FETCHED_PLACE(at, b_turned, TILE_COLUMNS)] = next_b[own][e];                                   \
    }

#define LENGTHEN(k)                                                                                            \
    float of_a[OWN_ROWS], of_b[OWN_COLUMNS];                                                                   \
    UNROLL for (int i = 0; i < OWN_ROWS; i++) of_a[i] = tile_a[(k) * STRIDE_A + OWN_ROW(i)];                   \
    UNROLL for (int j = 0; j < OWN_COLUMNS; j++) of_b[j] = tile_b[(k) * STRIDE_B + OWN_COLUMN(j)];             \
    UNROLL for (int i = 0; i < OWN_ROWS; i++)                                                                  \
        UNROLL for (int j = 0; j < OWN_COLUMNS; j++) chain[own][i][j] = fmaf(of_a[i], of_b[j], chain[own][i][j]);

FUNCTION void PRODUCT(const float *a, const float *b, float *c, const float *bias, const int activation,
                      const int rows, const int columns, const int inner, const int a_turned, const int b_turned,
                      const int block) {
    float chain[KEPT][OWN_ROWS][OWN_COLUMNS], sum[KEPT][OWN_ROWS][OWN_COLUMNS];
    float next_a[KEPT][FETCHED_A], next_b[KEPT][FETCHED_B];
    float *const tiles_a = shared, *const tiles_b = shared + 2 * DEPTH * STRIDE_A;
    const int across = (columns + TILE_COLUMNS - 1) / TILE_COLUMNS;
    const int first_row = block / across * TILE_ROWS, first_column = block % across * TILE_COLUMNS;
    const int steps = (inner + DEPTH - 1) / DEPTH;
    EACH_THREAD {
        FETCH(0)
        PUT(0)
    }
    WAIT;
    for (int first = 0; first < steps; first += CHAIN / DEPTH) {
        EACH_THREAD {
            UNROLL for (int i = 0; i < OWN_ROWS; i++)
                UNROLL for (int j = 0; j < OWN_COLUMNS; j++) chain[own][i][j] = 0.0f;
        }
        const int end = first + CHAIN / DEPTH < steps ? first + CHAIN / DEPTH : steps;
        for (int step = first; step < end; step++) {
            EACH_THREAD {
                const float *const tile_a = tiles_a + (step & 1) * DEPTH * STRIDE_A;
                const float *const tile_b = tiles_b + (step & 1) * DEPTH * STRIDE_B;
                if (step + 1 < steps) { FETCH(step + 1) }
                if (inner - step * DEPTH >= DEPTH) {
                    UNROLL for (int k = 0; k < DEPTH; k++) { LENGTHEN(k) }
                } else {
                    for (int k = 0; k < inner - step * DEPTH; k++) { LENGTHEN(k) }
                }
                if (step + 1 < steps) { PUT(step + 1) }
            }
            WAIT;
        }
        EACH_THREAD {
            UNROLL for (int i = 0; i < OWN_ROWS; i++)
                UNROLL for (int j = 0; j < OWN_COLUMNS; j++)
                    sum[own][i][j] = first == 0 ? chain[own][i][j] : sum[own][i][j] + chain[own][i][j];
        }
    }
    EACH_THREAD {
        UNROLL for (int i = 0; i < OWN_ROWS; i++) {
            const int row = first_row + OWN_ROW(i);
            UNROLL for (int j = 0; j < OWN_COLUMNS; j++) {
                const int column = first_column + OWN_COLUMN(j);
                if (row >= rows || column >= columns) continue;
                const float x = bias ? sum[own][i][j] + bias[column] : sum[own][i][j];
                c[row * columns + column] = activated(activation, x);
            }
        }
    }
}

#undef LENGTHEN
#undef PUT
#undef FETCH
#undef FETCHED_PLACE
#undef FETCHED_K
#undef STRIDE_B
#undef STRIDE_A
#undef FETCHED_B
#undef FETCHED_A
#undef OWN_COLUMN
#undef OWN_ROW
#undef GROUP_COLUMNS
#undef GROUP_ROWS
#undef OWN_COLUMNS
#undef OWN_ROWS
