// Operations of a plan. `block` counts the blocks of the operation.

using namespace arithmetic;

// Values of `k` in a chain, and in a step of a product.
#define CHAIN 512
#define DEPTH 16

// Numbers that the threads of a block share: two steps of both factors of a product, or the lanes of sums.
OF_BLOCK float shared[2 * DEPTH * 2 * (128 + 4)];

// Entry of the thread among `n`; threads beyond the last entry are done.
#define ENTRY(i, n)                        \
    const int i = block * THREADS + thread; \
    if (i >= (n)) continue;

FUNCTION float rectified(float x, float below) { return x <= 0.0f ? below * x : x; }
FUNCTION float smaller(float a, float b) { return b < a || b != b ? b : a; }
FUNCTION float larger(float a, float b) { return b > a || b != b ? b : a; }
FUNCTION float sign(float x) { return x > 0.0f ? 1.0f : x < 0.0f ? -1.0f : x; }
FUNCTION float absolute(float x) { return x <= 0.0f ? 0.0f - x : x; }

FUNCTION float activated(const int activation, float x) {
    return activation == 1 ? rectified(x, 0.0f) : activation == 2 ? rectified(x, 0.01f) : activation == 3 ? single::tanh(x) : x;
}

// Column that a number names, or `columns` where it names none.
FUNCTION int named_column(float index, const int columns) {
    return index >= 0.0f && index < (float)columns && index == (float)(int)index ? (int)index : columns;
}

// Sums of blocks of 1024 entries: a block of threads sums eight of them with 32 lanes each.
#define SUM_OF_BLOCKS(name, from, to, term)                                            \
    FUNCTION void name(const from *x, const int n, to *sums, const int block) { \
        to *const lanes = (to *)shared;                                                \
        EACH_THREAD {                                                                  \
            to lane = 0;                                                               \
            const int first = (block * (THREADS / 32) + thread / 32) * 1024;           \
            for (int i = 0; i < 32; i++) {                                             \
                const int at = first + i * 32 + thread % 32;                           \
                if (at < n) lane += term(x[at]);                                       \
            }                                                                          \
            lanes[thread] = lane;                                                      \
        }                                                                              \
        WAIT;                                                                          \
        EACH_THREAD {                                                                  \
            const int at = block * (THREADS / 32) + thread / 32;                       \
            if (thread % 32 != 0 || at * 1024 >= n) continue;                          \
            to fold[32];                                                               \
            for (int i = 0; i < 32; i++) fold[i] = lanes[thread + i];                  \
            for (int width = 16; width > 0; width /= 2)                                \
                for (int i = 0; i < width; i++) fold[i] += fold[i + width];            \
            sums[at] = fold[0];                                                        \
        }                                                                              \
    }
#define SAME(x) (x)
#define WIDE_SQUARE(x) ((double)(x) * (double)(x))
SUM_OF_BLOCKS(sum_of_blocks, float, float, SAME)
SUM_OF_BLOCKS(wide_sum_of_blocks, double, double, SAME)
SUM_OF_BLOCKS(squares_of_blocks, float, double, WIDE_SQUARE)

// Sum of `n` entries with a distance between them: a product with ones.
FUNCTION float sum_of_chains(const float *x, const int n, const int distance) {
    return product_entry(n, [](int) { return 1.0f; }, [=](int k) { return x[k * distance]; });
}

FUNCTION float largest_of(const float *row, const int n) {
    float best = row[0];
    for (int i = 1; i < n; i++) best = larger(best, row[i]);
    return best;
}

FUNCTION float place_of_largest(const float *row, const int n) {
    int best = 0;
    for (int i = 1; i < n; i++) best = row[i] > row[best] ? i : best;
    return (float)best;
}

// A number whose order as an integer is the total order of the numbers.
FUNCTION int order_of(float x) {
    const int word = (int)bits(x);
    return word ^ (int)((unsigned)(word >> 31) >> 1);
}

FUNCTION float ranked(const float *row, const int n, const int rank) {
    for (int i = 0; i < n; i++) {
        int below = 0, equal = 0;
        for (int j = 0; j < n; j++) {
            below += order_of(row[j]) < order_of(row[i]);
            equal += order_of(row[j]) == order_of(row[i]);
        }
        if (below <= rank && rank < below + equal) return row[i];
    }
    return ARITHMETIC_NAN_F;
}

FUNCTION double log_beta(const float *alpha, const int n, double total) {
    double sum = -0.0;
    for (int i = 0; i < n; i++) sum += ln_gamma((double)alpha[i]);
    return sum - ln_gamma(total);
}

FUNCTION double total_of(const float *alpha, const int n) {
    double total = -0.0;
    for (int i = 0; i < n; i++) total += (double)alpha[i];
    return total;
}

FUNCTION void dirichlet_density(const float *alpha, const float *log_point, const int n, float *result) {
    const double total = total_of(alpha, n);
    double kernel = -0.0;
    for (int i = 0; i < n; i++) kernel += ((double)alpha[i] - 1.0) * (double)log_point[i];
    result[0] = (float)(kernel - log_beta(alpha, n, total));
}

FUNCTION void dirichlet_score(const float *alpha, const float *log_point, const int n, float *result) {
    const double of_total = digamma(total_of(alpha, n));
    for (int i = 0; i < n; i++) result[i] = (float)(of_total - digamma((double)alpha[i]) + (double)log_point[i]);
}

FUNCTION void dirichlet_entropy(const float *alpha, const int n, float *result) {
    const double total = total_of(alpha, n);
    double excess = -0.0, own_part = -0.0;
    for (int i = 0; i < n; i++) excess += (double)alpha[i] - 1.0;
    for (int i = 0; i < n; i++) own_part += ((double)alpha[i] - 1.0) * digamma((double)alpha[i]);
    result[0] = (float)(log_beta(alpha, n, total) + excess * digamma(total) - own_part);
}

FUNCTION void dirichlet_entropy_slope(const float *alpha, const int n, float *result) {
    double excess = -0.0;
    for (int i = 0; i < n; i++) excess += (double)alpha[i] - 1.0;
    const double of_total = excess * trigamma(total_of(alpha, n));
    for (int i = 0; i < n; i++)
        result[i] = (float)(of_total - ((double)alpha[i] - 1.0) * trigamma((double)alpha[i]));
}

// Draw `index` of a run begins a stream for each entry.
FUNCTION Stream stream_of(const unsigned *run, const int index, const int entry) {
    const uint64_t seed = run[0] | (uint64_t)run[1] << 32;
    const uint64_t first = mix(seed + (uint64_t)index * ARITHMETIC_GOLDEN);
    return Stream{mix(first + (uint64_t)(entry + 1) * ARITHMETIC_GOLDEN)};
}

FUNCTION float normal_of(Stream words) { return (float)normal(words.word()); }

// Of 2^25 numbers one is rounded to 1.
FUNCTION float uniform_of(Stream words) {
    const float nearest = (float)uniform(words.word());
    return nearest < 1.0f ? nearest : 0.99999994f;
}

FUNCTION float log_gamma_of(float shape, Stream words) { return (float)log_gamma((double)shape, words); }
