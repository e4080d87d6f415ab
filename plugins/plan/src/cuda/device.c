// Words of the kernels for a card: a block is a block of threads, and each thread runs the same text.

typedef unsigned int u32;
typedef unsigned long long u64;

#define KERNEL(name) extern "C" __global__ void __launch_bounds__(THREADS) name(const Population p)
#define FUNCTION static __device__ __forceinline__
// A function that several kernels call, which is compiled once.
#define SHARED_TEXT static __device__ __noinline__
#define UNROLL _Pragma("unroll")
#define OF_BLOCK static __shared__ __align__(16)

#define BLOCK ((int)blockIdx.x)
#define PLACE ((int)blockIdx.y)

// The text of each thread. Numbers that a thread keeps from one text to the next are in arrays `[KEPT][...]`, at `own`.
#define EACH_THREAD for (int thread = (int)threadIdx.x, own = 0; own < 1; own++)
#define KEPT 1
#define WAIT __syncthreads()

FUNCTION u32 bits_of(float x) { return __float_as_uint(x); }
FUNCTION float float_of(u32 bits) { return __uint_as_float(bits); }
FUNCTION u64 wide_bits_of(double x) { return (u64)__double_as_longlong(x); }
FUNCTION double double_of(u64 bits) { return __longlong_as_double((long long)bits); }
