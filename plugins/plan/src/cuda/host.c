// Words of the kernels for a processor, which runs the same text literally: block after block, and in a block thread
// after thread, from one wait to the next.

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint32_t u32;
typedef unsigned long long u64;

static int BLOCK, PLACE;

#define KERNEL(name) static void name(const Population p)
#define FUNCTION static inline
#define SHARED_TEXT static
#define UNROLL
#define OF_BLOCK static _Alignas(16)

#define EACH_THREAD for (int thread = 0, own = 0; thread < THREADS; own = ++thread)
#define KEPT THREADS
#define WAIT

FUNCTION u32 bits_of(float x) { u32 bits; memcpy(&bits, &x, sizeof bits); return bits; }
FUNCTION float float_of(u32 bits) { float x; memcpy(&x, &bits, sizeof x); return x; }
FUNCTION u64 wide_bits_of(double x) { u64 bits; memcpy(&bits, &x, sizeof bits); return bits; }
FUNCTION double double_of(u64 bits) { double x; memcpy(&x, &bits, sizeof x); return x; }
