// Elementary functions of f64: the module `double`.
#pragma once

#include "bits.cuh"

namespace arithmetic {

#define ARITHMETIC_INFINITY arithmetic::double_from_bits((uint64_t)0x7ff0000000000000ull)
#define ARITHMETIC_NAN arithmetic::double_from_bits((uint64_t)0x7ff8000000000000ull)
#define ARITHMETIC_ROUNDING 6755399441055744.0
#define ARITHMETIC_LN_2_HIGH 0.693147180559663
#define ARITHMETIC_LN_2_LOW 2.8235290563031577e-13

ARITHMETIC double held(double x, double low, double high) {
    x = x < low ? low : x;
    return x > high ? high : x;
}
ARITHMETIC double known(double x, double y) { return x != x ? ARITHMETIC_NAN : y; }
ARITHMETIC double power_of_two(int32_t n) { return double_from_bits((uint64_t)((int64_t)n + 1023) << 52); }
ARITHMETIC double scaled(double y, int32_t n) {
    int32_t half = n >> 1;
    return y * power_of_two(half) * power_of_two((int32_t)((uint32_t)n - (uint32_t)half));
}

ARITHMETIC double exp_parts(double x, double low, int32_t& whole) {
    const double EXP[11] = {0.5, 0.1666666666666667, 0.04166666666666667, 0.008333333333326136, 0.0013888888888883748,
        0.00019841269874820627, 2.4801587325547743e-05, 2.7557255400206422e-06, 2.75572736431103e-07,
        2.5105217004720745e-08, 2.0914686968086876e-09};
    double shifted = x * 1.44269504088896340736 + ARITHMETIC_ROUNDING;
    double n = shifted - ARITHMETIC_ROUNDING;
    double high = x - n * ARITHMETIC_LN_2_HIGH;
    low = n * ARITHMETIC_LN_2_LOW - low;
    double r = high - low;
    double lost = (high - r) - low;
    whole = (int32_t)(bits(shifted) - bits(ARITHMETIC_ROUNDING));
    return r + (r * r * polynomial(EXP, r) + lost);
}
ARITHMETIC double ln_parts(double k, double f, double correction) {
    const double LN[8] = {0.6666666666666666, 0.4000000000000088, 0.28571428570801954, 0.22222222392089008, 0.18181795600060793,
        0.15386241881938595, 0.13268714792348096, 0.1308723619665962};
    double s = f / (2.0 + f);
    double z = s * s, half = 0.5 * f * f;
    double series = s * (half + z * polynomial(LN, z));
    return k * ARITHMETIC_LN_2_HIGH - ((half - (series + (k * ARITHMETIC_LN_2_LOW + correction))) - f);
}
ARITHMETIC int64_t split(double x, double& f) {
    const uint64_t ROOT = 0x3fe6a09e667f3bcdull;
    bool is_small = x < 2.2250738585072014e-308;
    uint64_t b = bits(is_small ? x * 18014398509481984.0 : x) + (0x3ff0000000000000ull - ROOT);
    f = double_from_bits((uint64_t)((b & 0x000fffffffffffffull) + ROOT)) - 1.0;
    return (int64_t)(b >> 52) - 1023 - (is_small ? 54 : 0);
}
ARITHMETIC double logarithm_outside(double x) {
    return x == 0.0 ? -ARITHMETIC_INFINITY : x == ARITHMETIC_INFINITY ? x : ARITHMETIC_NAN;
}

ARITHMETIC double exp(double x) {
    int32_t n;
    double rest = exp_parts(held(x, -746.0, 710.0), 0.0, n);
    return known(x, scaled(1.0 + rest, n));
}
ARITHMETIC double exp_m1(double x) {
    int32_t n;
    double rest = exp_parts(held(x, -40.0, 710.0), 0.0, n), value;
    if (n == 0) {
        value = x == 0.0 ? x : rest;
    } else if (n > 53) {
        value = scaled(1.0 + rest, n);
    } else {
        double power = power_of_two(n);
        value = rest * power + (power - 1.0);
    }
    return known(x, value);
}
ARITHMETIC double ln(double x) {
    if (!(x > 0.0 && x < ARITHMETIC_INFINITY)) return logarithm_outside(x);
    double f;
    int64_t k = split(x, f);
    return ln_parts((double)k, f, 0.0);
}
ARITHMETIC double ln_1p(double x) {
    if (x == 0.0) return x;
    if (!(x > -1.0 && x < ARITHMETIC_INFINITY)) return logarithm_outside(1.0 + x);
    double sum = 1.0 + x;
    double lost = x < 1.0 ? x - (sum - 1.0) : 1.0 - (sum - x);
    double f;
    int64_t k = split(sum, f);
    return k == 0 ? ln_parts(0.0, x, 0.0) : ln_parts((double)k, f, lost / sum);
}
ARITHMETIC double tanh(double x) {
    double below = exp_m1(-2.0 * magnitude(x));
    return known(x, with_sign(-below / (2.0 + below), x));
}

ARITHMETIC double two_sum(double a, double b, double& lost) {
    double sum = a + b;
    double of_b = sum - a;
    lost = (a - (sum - of_b)) + (b - of_b);
    return sum;
}
ARITHMETIC double upper(double x) { return double_from_bits(bits(x) & ~(uint64_t)0x07ffffff); }
ARITHMETIC double two_product(double a, double b, double& lost) {
    double a_high = upper(a), b_high = upper(b);
    double a_low = a - a_high, b_low = b - b_high;
    double product = a * b;
    lost = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low;
    return product;
}

}  // namespace arithmetic
