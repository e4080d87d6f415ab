// Prints the digests of `examples/digests.rs` as computed on a card, in the same format (src/digests.rs says what they are).
//
//     nvcc -std=c++17 -O3 -arch=sm_90 --fmad=false --extended-lambda check.cu -o check && ./check
//     g++ -std=c++17 -O3 -ffp-contract=off -x c++ check.cu -o check -lpthread    the same text on a processor
//
// On a processor, `check fast` computes the kept classes alone, as the example does with `--fast`.
#include "arithmetic.cuh"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>


namespace arithmetic {


enum { CLASSES = 4096, KEPT = 16 };

ARITHMETIC double argument(uint64_t i, uint64_t word, double low, double high) {
    return i % 2 == 0 ? double_from_bits(word) : low + (high - low) * uniform(word);
}
ARITHMETIC uint64_t summand(uint64_t i, uint64_t b) { return mix(b + i * ARITHMETIC_GOLDEN); }
ARITHMETIC float number(uint64_t i) { return (float)normal(mix(i)); }

// Each family: the summand of input i, and the number of inputs as a power of two.
#define SINGLE(NAME)                                                                          \
    struct Single_##NAME {                                                                    \
        static const int BITS = 32;                                                           \
        static ARITHMETIC_MEMBER uint64_t of(uint64_t i) {                                    \
            return mix(i << 32 | (uint64_t)bits(single::NAME(from_bits((uint32_t)i))));       \
        }                                                                                     \
    };
#define DOUBLE(NAME, CALL, LOW, HIGH)                                        \
    struct Double_##NAME {                                                   \
        static const int BITS = 28;                                          \
        static ARITHMETIC_MEMBER uint64_t of(uint64_t i) {                   \
            uint64_t word = mix(i);                                          \
            double x = argument(i, word, LOW, HIGH);                         \
            double y = argument(i, mix(word), -64.0, 64.0);                  \
            (void)y;                                                         \
            return summand(i, bits(CALL));                                   \
        }                                                                    \
    };
SINGLE(exp)
SINGLE(ln)
SINGLE(ln_1p)
SINGLE(tanh)
SINGLE(sigmoid)
SINGLE(softplus)
DOUBLE(exp, arithmetic::exp(x), -750.0, 720.0)
DOUBLE(exp_m1, arithmetic::exp_m1(x), -4.0, 4.0)
DOUBLE(ln, arithmetic::ln(x), 0.0, 4.0)
DOUBLE(ln_1p, arithmetic::ln_1p(x), -1.0, 3.0)
DOUBLE(tanh, arithmetic::tanh(x), -4.0, 4.0)
DOUBLE(sin, arithmetic::sin(x), -2048.0, 2048.0)
DOUBLE(cos, arithmetic::cos(x), -2048.0, 2048.0)
DOUBLE(pow, arithmetic::pow(x, y), 0.0, 16.0)
DOUBLE(ln_gamma, arithmetic::ln_gamma(x), 0.0, 16.0)
DOUBLE(digamma, arithmetic::digamma(x), 0.0, 16.0)
DOUBLE(trigamma, arithmetic::trigamma(x), 0.0, 16.0)
struct Normal {
    static const int BITS = 24;
    static ARITHMETIC_MEMBER uint64_t of(uint64_t i) { return summand(i, bits(normal(mix(i)))); }
};
struct LogGamma {
    static const int BITS = 24;
    static ARITHMETIC_MEMBER uint64_t of(uint64_t i) {
        double shape = double_from_bits((uint64_t)((i % 16 + 1017) << 52)) * (1.0 + uniform(mix(i)));
        Stream words = {mix(i)};
        return summand(i, bits(log_gamma(shape, words)));
    }
};

// ---- products, sums and steps, one entry in each call ----

enum { ROWS = 17, COLUMNS = 33, MANY = 100000, PARAMETERS = 4096, SPLIT = 1000, STEPS = 200 };

// A buffer in the card's memory, or in the processor's.
struct Buffers {
    const float *a, *b;
    float* c;
    int k;
};
// Entry of kind 0: nn, 1: nt, 2: tn, 3: sums over rows.
ARITHMETIC float entry(const Buffers& it, int kind, int at) {
    int row = at / COLUMNS, column = at % COLUMNS, k_all = it.k;
    const float *a = it.a, *b = it.b;
    if (kind == 0)
        return product_entry(k_all, [=](int k) { return a[row * k_all + k]; }, [=](int k) { return b[k * COLUMNS + column]; });
    if (kind == 1)
        return product_entry(k_all, [=](int k) { return a[row * k_all + k]; }, [=](int k) { return b[column * k_all + k]; });
    if (kind == 2)
        return product_entry(k_all, [=](int k) { return a[k * ROWS + row]; }, [=](int k) { return b[k * COLUMNS + column]; });
    return product_entry(k_all, [=](int) { return 1.0f; }, [=](int k) { return b[k * COLUMNS + column]; });
}
struct AdamState {
    float *x, *first, *second, *gradient, *target;
};
ARITHMETIC float gradient_of(uint64_t step, int at) {
    return step >= 60 && at % 3 != 0 ? 0.0f : number((1ull << 36) + (step << 20) + at);
}
ARITHMETIC void adam_entry(const AdamState& it, int at, float scale, bool is_scaled, float step, float root) {
    float g = is_scaled ? it.gradient[at] * scale : it.gradient[at];
    adam(it.x[at], g, it.first[at], it.second[at], 0.9f, 0.999f, step, root);
    it.target[at] = followed(it.target[at], it.x[at], 0.005f);
}

#ifdef __CUDACC__
template <class Family>
__global__ void classes(unsigned long long* sums) {
    uint64_t thread = (uint64_t)blockIdx.x * blockDim.x + threadIdx.x, threads = (uint64_t)gridDim.x * blockDim.x;
    uint64_t sum = 0;
    for (uint64_t i = thread; i < 1ull << Family::BITS; i += threads) sum += Family::of(i);
    atomicAdd(&sums[thread % CLASSES], (unsigned long long)sum);
}
template <class F>
__global__ void each(int n, F f) {
    int at = blockIdx.x * blockDim.x + threadIdx.x;
    if (at < n) f(at);
}
#define LAMBDA [=] __device__
template <class T>
T* buffer(size_t n) {
    T* p;
    // The processor's memory, which the card reads and writes too; a few megabytes in all.
    if (cudaMallocHost(&p, n * sizeof(T)) != cudaSuccess) exit(1);
    memset(p, 0, n * sizeof(T));
    return p;
}
template <class F>
void run(int n, F f) {
    each<<<(n + 127) / 128, 128>>>(n, f);
    cudaError_t error = cudaDeviceSynchronize();
    if (error != cudaSuccess) {
        fprintf(stderr, "%s\n", cudaGetErrorString(error));
        exit(1);
    }
}
template <class Family>
std::vector<uint64_t> all_classes(bool) {
    std::vector<uint64_t> result(CLASSES);
    unsigned long long* sums;
    if (cudaMalloc(&sums, CLASSES * 8) != cudaSuccess) exit(1);
    cudaMemset(sums, 0, CLASSES * 8);
    // A multiple of the number of classes, so that a thread's inputs are of one class.
    classes<Family><<<4096, 256>>>(sums);
    cudaError_t error = cudaMemcpy(result.data(), sums, CLASSES * 8, cudaMemcpyDeviceToHost);
    if (error != cudaSuccess) {
        fprintf(stderr, "%s\n", cudaGetErrorString(error));
        exit(1);
    }
    cudaFree(sums);
    return result;
}
#else
#define LAMBDA [=]
template <class T>
T* buffer(size_t n) {
    return new T[n]();
}
template <class F>
void run(int n, F f) {
    for (int at = 0; at < n; at++) f(at);
}
template <class Family>
std::vector<uint64_t> all_classes(bool is_fast) {
    std::vector<uint64_t> sums(CLASSES);
    for (uint64_t i = 0; i < 1ull << Family::BITS; i++)
        if (!is_fast || i % CLASSES < KEPT) sums[i % CLASSES] += Family::of(i);
    return sums;
}
#endif

template <class Family>
void print(const char* name, bool is_fast) {
    std::vector<uint64_t> sums = all_classes<Family>(is_fast);
    uint64_t total = 0;
    for (uint64_t sum : sums) total += sum;
    printf("%s %016llx", name, is_fast ? 0ull : (unsigned long long)total);
    for (int i = 0; i < KEPT; i++) printf(" %016llx", (unsigned long long)sums[i]);
    printf("\n");
}
void print(const char* name, uint64_t digest) { printf("%s %016llx\n", name, (unsigned long long)digest); }

uint64_t of_singles(const float* values, int n, uint64_t from = 0) {
    uint64_t sum = 0;
    for (int i = 0; i < n; i++) sum += summand(from + i, bits(values[i]));
    return sum;
}

// The sums of the blocks of n terms.
template <class T, class Term>
T* block_sums(int n, Term term) {
    int blocks = (n + 1023) / 1024;
    T* sums = buffer<T>(blocks);
    run(blocks, LAMBDA(int block) {
        int begin = block * 1024, count = n - begin < 1024 ? n - begin : 1024;
        sums[block] = block_sum<T>(count, [=](int i) { return term(begin + i); });
    });
    return sums;
}
// The sum of all terms, level by level.
template <class T, class Term>
T sum_in_blocks(int n, Term term) {
    T* sums = block_sums<T>(n, term);
    for (n = (n + 1023) / 1024; n > 1; n = (n + 1023) / 1024) {
        const T* below = sums;
        sums = block_sums<T>(n, LAMBDA(int i) { return below[i]; });
    }
    return sums[0];
}

void products() {
    uint64_t digests[4] = {};
    const int sizes[4] = {24, 512, 513, 1300};
    for (int k : sizes) {
        float *a = buffer<float>(ROWS * k), *b = buffer<float>(COLUMNS * k), *c = buffer<float>(ROWS * COLUMNS);
        run(ROWS * k, LAMBDA(int i) { a[i] = number((1ull << 32) + i); });
        run(COLUMNS * k, LAMBDA(int i) { b[i] = number((1ull << 33) + i); });
        Buffers it = {a, b, c, k};
        for (int kind = 0; kind < 4; kind++) {
            int n = kind == 3 ? (int)COLUMNS : ROWS * COLUMNS;
            run(n, LAMBDA(int at) { it.c[at] = entry(it, kind, at); });
            digests[kind] = mix(digests[kind]) + of_singles(c, n);
        }
    }
    print("steps.product_nn", digests[0]);
    print("steps.product_nt", digests[1]);
    print("steps.product_tn", digests[2]);
    print("steps.row_sums", digests[3]);
    float* many = buffer<float>(MANY);
    run(MANY, LAMBDA(int i) { many[i] = number((1ull << 34) + i); });
    print("steps.sum", bits(sum_in_blocks<float>(MANY, LAMBDA(int i) { return many[i]; })));
    print("steps.sum_of_squares", bits(sum_in_blocks<double>(MANY, LAMBDA(int i) { return (double)many[i] * (double)many[i]; })));
}

void steps() {
    AdamState it = {buffer<float>(PARAMETERS), buffer<float>(PARAMETERS), buffer<float>(PARAMETERS),
                    buffer<float>(PARAMETERS), buffer<float>(PARAMETERS)};
    run(PARAMETERS, LAMBDA(int at) { it.x[at] = it.target[at] = number((1ull << 35) + at); });
    uint64_t norms = 0;
    for (uint64_t step = 0; step < STEPS; step++) {
        run(PARAMETERS, LAMBDA(int at) { it.gradient[at] = gradient_of(step, at); });
        const float* g = it.gradient;
        double squares = 0.0;
        squares += sum_in_blocks<double>(SPLIT, LAMBDA(int i) { return (double)g[i] * (double)g[i]; });
        squares += sum_in_blocks<double>(PARAMETERS - SPLIT, LAMBDA(int i) { return (double)g[SPLIT + i] * (double)g[SPLIT + i]; });
        double norm = sqrt(squares);
        norms += summand(step, bits(norm));
        bool is_scaled = norm > 50.0;
        float scale = is_scaled ? (float)(50.0 / norm) : 1.0f;
        double t = (double)(step + 1);
        float size = (float)(1e-3 / (1.0 - arithmetic::pow(0.9, t)));
        float root = (float)(1.0 / sqrt(1.0 - arithmetic::pow(0.999, t)));
        run(PARAMETERS, LAMBDA(int at) { adam_entry(it, at, scale, is_scaled, size, root); });
    }
    print("steps.adam", of_singles(it.x, PARAMETERS) + of_singles(it.first, PARAMETERS, PARAMETERS) +
                            of_singles(it.second, PARAMETERS, 2 * PARAMETERS));
    print("steps.norms", norms);
    print("steps.average", of_singles(it.target, PARAMETERS));
}

int run(int count, char** arguments) {
    bool is_fast = count > 1 && strcmp(arguments[1], "fast") == 0;
#ifdef __CUDACC__
    is_fast = false;
#endif
    print<Single_exp>("f32.exp", is_fast);
    print<Single_ln>("f32.ln", is_fast);
    print<Single_ln_1p>("f32.ln_1p", is_fast);
    print<Single_tanh>("f32.tanh", is_fast);
    print<Single_sigmoid>("f32.sigmoid", is_fast);
    print<Single_softplus>("f32.softplus", is_fast);
    print<Double_exp>("f64.exp", is_fast);
    print<Double_exp_m1>("f64.exp_m1", is_fast);
    print<Double_ln>("f64.ln", is_fast);
    print<Double_ln_1p>("f64.ln_1p", is_fast);
    print<Double_tanh>("f64.tanh", is_fast);
    print<Double_sin>("f64.sin", is_fast);
    print<Double_cos>("f64.cos", is_fast);
    print<Double_pow>("f64.pow", is_fast);
    print<Double_ln_gamma>("f64.ln_gamma", is_fast);
    print<Double_digamma>("f64.digamma", is_fast);
    print<Double_trigamma>("f64.trigamma", is_fast);
    print<Normal>("draw.normal", is_fast);
    print<LogGamma>("draw.log_gamma", is_fast);
    products();
    steps();
    return 0;
}
}  // namespace arithmetic

int main(int argc, char** argv) { return arithmetic::run(argc, argv); }
