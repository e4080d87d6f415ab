// Functions of f32: the module `single`.
#pragma once

#include "bits.cuh"

namespace arithmetic {
namespace single {

#define ARITHMETIC_INFINITY_F arithmetic::from_bits(0x7f800000u)
#define ARITHMETIC_NAN_F arithmetic::from_bits(0x7fc00000u)
#define ARITHMETIC_ROUNDING_F 12582912.0f

ARITHMETIC float held(float x, float low, float high) {
    x = x < low ? low : x;
    return x > high ? high : x;
}
ARITHMETIC float known(float x, float y) { return x != x ? ARITHMETIC_NAN_F : y; }
ARITHMETIC float power_of_two(int32_t n) { return from_bits(((uint32_t)n + 127u) << 23); }

ARITHMETIC float exp_parts(float x, int32_t& whole) {
    const float EXP[6] = {0.5f, 0.16666667f, 0.041666467f, 0.0083333105f, 0.001393365f, 0.00019890991f};
    float shifted = x * 1.44269504088896340736f + ARITHMETIC_ROUNDING_F;
    float n = shifted - ARITHMETIC_ROUNDING_F;
    float r = (x - n * 0.693359375f) - n * -0.00021219444f;
    whole = (int32_t)(bits(shifted) - bits(ARITHMETIC_ROUNDING_F));
    return 1.0f + (r + r * r * polynomial(EXP, r));
}
ARITHMETIC float ln_parts(float k, float f, float correction) {
    const float LN[9] = {0.3333333f, -0.24999997f, 0.20000716f, -0.16667798f, 0.14249034f, -0.12425794f, 0.116858006f, -0.11479056f,
        0.06969562f};
    float square = f * f;
    float cubic = square * f * polynomial(LN, f);
    float rest = (cubic + (k * -0.00021219444f + correction)) - 0.5f * square;
    return (f + rest) + k * 0.693359375f;
}
ARITHMETIC int32_t split(float x, float& f) {
    uint32_t b = bits(x) + (0x3f800000u - 0x3f3504f3u);
    f = from_bits((b & 0x007fffffu) + 0x3f3504f3u) - 1.0f;
    return (int32_t)(b >> 23) - 127;
}

ARITHMETIC float exp(float x) {
    int32_t n;
    float factor = exp_parts(held(x, -104.0f, 89.0f), n);
    int32_t half = n >> 1;
    return known(x, factor * power_of_two(half) * power_of_two(n - half));
}
ARITHMETIC float ln(float x) {
    bool is_small = x < 1.17549435e-38f;
    float f;
    int32_t k = split(is_small ? x * 8388608.0f : x, f);
    float inside = ln_parts((float)(is_small ? k - 23 : k), f, 0.0f);
    inside = x == ARITHMETIC_INFINITY_F ? x : inside;
    float at_most_zero = x == 0.0f ? -ARITHMETIC_INFINITY_F : ARITHMETIC_NAN_F;
    return x > 0.0f ? inside : at_most_zero;
}
ARITHMETIC float ln_1p(float x) {
    float sum = 1.0f + x;
    float lost = x < 1.0f ? x - (sum - 1.0f) : 1.0f - (sum - x);
    float f;
    int32_t k = split(sum, f);
    float inside = ln_parts((float)k, k == 0 ? x : f, k == 0 ? 0.0f : lost / sum);
    inside = x == ARITHMETIC_INFINITY_F || x == 0.0f ? x : inside;
    float outside = x == -1.0f ? -ARITHMETIC_INFINITY_F : ARITHMETIC_NAN_F;
    return x > -1.0f ? inside : outside;
}
ARITHMETIC float tanh(float x) {
    const float TANH[6] = {-0.33333334f, 0.13333304f, -0.053959258f, 0.021768918f, -0.008343945f, 0.0022927448f};
    float size = held(magnitude(x), 0.0f, 9.1f);
    int32_t n;
    float factor = exp_parts(2.0f * size, n);
    float large = 1.0f - 2.0f / (factor * power_of_two(n) + 1.0f);
    float square = size * size;
    float small = size + size * (square * polynomial(TANH, square));
    return known(x, with_sign(size < 0.625f ? small : large, x));
}
ARITHMETIC float sigmoid(float x) {
    float tail = exp(-magnitude(x));
    return known(x, (x < 0.0f ? tail : 1.0f) / (1.0f + tail));
}
ARITHMETIC float softplus(float x) {
    float tail = exp(-magnitude(x));
    float k = tail >= 0.4142135f ? 1.0f : 0.0f;
    float less = tail - k;
    float lost = tail - (less + k);
    float rest = ln_parts(k, (1.0f - 0.5f * k) * less, 0.6866f * lost);
    return known(x, (x > 0.0f ? x : 0.0f) + rest);
}

}  // namespace single

}  // namespace arithmetic
