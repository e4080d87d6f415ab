// Words of the kernels for a card: a block is a block of threads, and each thread runs the same text.

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

