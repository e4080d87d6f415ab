// The arithmetic of this crate in CUDA C++: each function is the one of the same name in the Rust modules, operation by
// operation, and gives the same bits. Methods, sources and errors stand there.
//
// To be compiled with --fmad=false (NVRTC: --fmad=false) and without -use_fast_math, so that each operation is rounded by
// itself and denormals are kept; fused multiply-adds are written out. The header also compiles as plain C++ for a
// processor (g++ -std=c++17 -ffp-contract=off), with which the text is checked where no card is.
#pragma once

#include "double.cuh"
#include "gamma_and_draws.cuh"
#include "single.cuh"
#include "trigonometry_and_power.cuh"

namespace arithmetic {

// One entry of a product over `count` values of k; `a` and `b` give the factors at k.
template <class A, class B>
ARITHMETIC float product_entry(int count, A a, B b) {
    float sum = 0.0f;
    for (int begin = 0; begin < count; begin += 512) {
        int end = begin + 512 < count ? begin + 512 : count;
        float chain = 0.0f;
        for (int k = begin; k < end; k++) chain = fmaf(a(k), b(k), chain);
        sum = begin == 0 ? chain : sum + chain;
    }
    return sum;
}
// The sum of a block of at most 1024 terms.
template <class T, class Term>
ARITHMETIC T block_sum(int count, Term term) {
    T lanes[32];
    for (int l = 0; l < 32; l++) lanes[l] = 0;
    for (int i = 0; i < count; i++) lanes[i % 32] += term(i);
    for (int width = 16; width > 0; width /= 2)
        for (int l = 0; l < width; l++) lanes[l] += lanes[l + width];
    return lanes[0];
}
ARITHMETIC float normal_or_zero(float moment) { return magnitude(moment) < 1.17549435e-38f ? 0.0f : moment; }
// One entry's step of Adam; b1, b2, step, root as the module `steps` has them.
ARITHMETIC void adam(float& x, float g, float& m, float& v, float b1, float b2, float step, float root) {
    m = normal_or_zero(b1 * m + (1.0f - b1) * g);
    v = normal_or_zero(b2 * v + (1.0f - b2) * g * g);
    x -= step * m / (sqrtf(v) * root + 1e-8f);
}
ARITHMETIC float followed(float target, float source, float tau) { return target + tau * (source - target); }

}  // namespace arithmetic
