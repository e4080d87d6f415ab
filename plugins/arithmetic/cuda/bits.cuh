// Bits of numbers, and what the other headers are written with.
#pragma once


#ifndef __CUDACC_RTC__
#include <cmath>
#include <cstdint>
#include <cstring>
#else
typedef unsigned char uint8_t;
typedef unsigned int uint32_t;
typedef int int32_t;
typedef unsigned long long uint64_t;
typedef long long int64_t;
#endif

#if defined(__CUDACC__) || defined(__CUDACC_RTC__)
#define ARITHMETIC __host__ __device__ __forceinline__
#define ARITHMETIC_MEMBER __host__ __device__ __forceinline__
// Long ones, which are called.
#define ARITHMETIC_CALLED static __host__ __device__ __noinline__
#else
#define ARITHMETIC static inline
#define ARITHMETIC_MEMBER inline
#define ARITHMETIC_CALLED static
#endif

namespace arithmetic {

ARITHMETIC uint32_t bits(float x) {
#ifdef __CUDA_ARCH__
    return (uint32_t)__float_as_int(x);
#else
    uint32_t b;
    memcpy(&b, &x, 4);
    return b;
#endif
}
ARITHMETIC float from_bits(uint32_t b) {
#ifdef __CUDA_ARCH__
    return __int_as_float((int)b);
#else
    float x;
    memcpy(&x, &b, 4);
    return x;
#endif
}
ARITHMETIC uint64_t bits(double x) {
#ifdef __CUDA_ARCH__
    return (uint64_t)__double_as_longlong(x);
#else
    uint64_t b;
    memcpy(&b, &x, 8);
    return b;
#endif
}
ARITHMETIC double double_from_bits(uint64_t b) {
#ifdef __CUDA_ARCH__
    return __longlong_as_double((long long)b);
#else
    double x;
    memcpy(&x, &b, 8);
    return x;
#endif
}
// Upper word of the product of two words.
ARITHMETIC uint64_t upper_product(uint64_t a, uint64_t b) {
#ifdef __CUDA_ARCH__
    return __umul64hi(a, b);
#else
    return (uint64_t)((unsigned __int128)a * b >> 64);
#endif
}
ARITHMETIC int leading_zeros(uint64_t x) {
#ifdef __CUDA_ARCH__
    return __clzll((long long)x);
#else
    return __builtin_clzll(x);
#endif
}
ARITHMETIC float magnitude(float x) { return from_bits(bits(x) & 0x7fffffffu); }
ARITHMETIC double magnitude(double x) { return double_from_bits(bits(x) & 0x7fffffffffffffffull); }
ARITHMETIC float with_sign(float x, float sign) { return from_bits((bits(x) & 0x7fffffffu) | (bits(sign) & 0x80000000u)); }
ARITHMETIC double with_sign(double x, double sign) {
    return double_from_bits((bits(x) & 0x7fffffffffffffffull) | (bits(sign) & 0x8000000000000000ull));
}

template <class T, int N>
ARITHMETIC T polynomial(const T (&c)[N], T x) {
    T sum = c[N - 1];
#pragma unroll
    for (int i = N - 2; i >= 0; i--) sum = sum * x + c[i];
    return sum;
}

}  // namespace arithmetic
