// Words of the kernels for a processor, which runs the same text literally: block after block, and in a block thread
// after thread, from one wait to the next.

#include <cstdio>
#include <cstdlib>

static int BLOCK, PLACE;

#define KERNEL(name) static void name(const Population p)
#define FUNCTION static inline
#define SHARED_TEXT static
#define UNROLL
#define OF_BLOCK alignas(16) static

#define EACH_THREAD for (int thread = 0, own = 0; thread < THREADS; own = ++thread)
#define KEPT THREADS
#define WAIT

