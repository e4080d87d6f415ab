// Sine, cosine and powers of f64: the modules `trigonometry` and `power`.
#pragma once

#include "double.cuh"

namespace arithmetic {

#define ARITHMETIC_HALF_PI 1.5707963267948966

ARITHMETIC double sin_inside(double high, double low) {
    const double FIRST = -0.16666666666666666;
    const double SIN[6] = {0.008333333333333331, -0.00019841269841265063, 2.7557319219337312e-06, -2.5052106231802837e-08,
        1.6058531516797758e-10, -7.586691094197958e-13};
    if (high == 0.0) return high;
    double z = high * high;
    double cube = z * high;
    double series = polynomial(SIN, z);
    return high - ((z * (0.5 * low - cube * series) - low) - cube * FIRST);
}
ARITHMETIC double cos_inside(double high, double low) {
    const double COS[6] = {0.041666666666666664, -0.0013888888888887398, 2.480158729876456e-05, -2.7557317271145144e-07,
        2.087614614655861e-09, -1.1382623647474604e-11};
    double z = high * high;
    double half = 0.5 * z;
    double near = 1.0 - half;
    return near + (((1.0 - near) - half) + (z * (z * polynomial(COS, z)) - high * low));
}
ARITHMETIC uint64_t reduced_by_parts(double x, double& high, double& low) {
    double shifted = x * 0.63661977236758134308 + ARITHMETIC_ROUNDING;
    double n = shifted - ARITHMETIC_ROUNDING;
    if (n == 0.0) {
        high = x;
        low = 0.0;
        return 0;
    }
    double lost;
    double sum = two_sum(x - n * 1.5707963267948344, -(n * 6.223372171896261e-14), lost);
    double tail = lost - n * 3.5215598651832e-27;
    high = sum + tail;
    low = (sum - high) + tail;
    return bits(shifted) - bits(ARITHMETIC_ROUNDING);
}
ARITHMETIC_CALLED uint64_t reduced_in_integers(double x, double& high, double& low) {
    const uint64_t TWO_OVER_PI[21] = {0x0000000000000000ull, 0xa2f9836e4e441529ull, 0xfc2757d1f534ddc0ull, 0xdb6295993c439041ull,
        0xfe5163abdebbc561ull, 0xb7246e3a424dd2e0ull, 0x06492eea09d1921cull, 0xfe1deb1cb129a73eull,
        0xe88235f52ebb4484ull, 0xe99c7026b45f7e41ull, 0x3991d639835339f4ull, 0x9c845f8bbdf9283bull,
        0x1ff897ffde05980full, 0xef2f118b5a0a6d1full, 0x6d367ecf27cb09b7ull, 0x4f463f669e5fea2dull,
        0x7527bac7ebe5f17bull, 0x3d0739f78a5292eaull, 0x6bfb5fb11f8d5d08ull, 0x56033046fc7b6babull,
        0xf0cfbc209af4361dull};
    uint64_t b = bits(magnitude(x));
    uint64_t mantissa = (b & 0x000fffffffffffffull) | 0x0010000000000000ull;
    uint64_t start = (b >> 52) - 1013;
    uint64_t w[3];
    for (int at = 0; at < 3; at++) {
        int index = (int)(start / 64) + at, shift = (int)(start % 64);
        w[at] = (TWO_OVER_PI[index] << shift) | (TWO_OVER_PI[index + 1] >> 1 >> (63 - shift));
    }
    uint64_t lowest = mantissa * w[2], carry = upper_product(mantissa, w[2]);
    uint64_t middle = mantissa * w[1] + carry;
    carry = upper_product(mantissa, w[1]) + (middle < carry ? 1 : 0);
    uint64_t top = mantissa * w[0] + carry;
    bool is_above = (top >> 61 & 1) == 1;
    uint64_t quadrant = (top >> 62) + (is_above ? 1 : 0);
    uint64_t d0 = top << 2 | middle >> 62, d1 = middle << 2 | lowest >> 62, d2 = lowest << 2;
    if (is_above) {
        uint64_t carry_1 = d2 == 0 ? 1 : 0, carry_0 = d1 == 0 && d2 == 0 ? 1 : 0;
        d0 = ~d0 + carry_0;
        d1 = ~d1 + carry_1;
        d2 = 0 - d2;
    }
    int shift = 0;
    if (d0 == 0) {
        d0 = d1;
        d1 = d2;
        d2 = 0;
        shift = 64;
    }
    int zeros = leading_zeros(d0);
    uint64_t first = (d0 << zeros) | (d1 >> 1 >> (63 - zeros));
    uint64_t second = (d1 << zeros) | (d2 >> 1 >> (63 - zeros));
    double unit = double_from_bits((uint64_t)(1023 - 53 - shift - zeros) << 52);
    double turns_high = (double)(first >> 11) * unit;
    double turns_low = (double)((first & 0x7ff) << 42 | second >> 22) * (unit * 1.1102230246251565e-16);
    double lost;
    double product = two_product(turns_high, ARITHMETIC_HALF_PI, lost);
    double tail = lost + (turns_high * 6.123233995736766e-17 + turns_low * ARITHMETIC_HALF_PI);
    double sum = product + tail;
    double rest = (product - sum) + tail;
    bool is_negative = is_above != (x < 0.0);
    high = is_negative ? -sum : sum;
    low = is_negative ? -rest : rest;
    return x < 0.0 ? 0 - quadrant : quadrant;
}
ARITHMETIC double quarter_turned(double x, uint64_t turns) {
    if (!(magnitude(x) < ARITHMETIC_INFINITY)) return ARITHMETIC_NAN;
    double high, low;
    uint64_t quadrant = magnitude(x) < 1024.0 ? reduced_by_parts(x, high, low) : reduced_in_integers(x, high, low);
    quadrant += turns;
    double value = (quadrant & 1) == 0 ? sin_inside(high, low) : cos_inside(high, low);
    return (quadrant & 2) == 0 ? value : -value;
}
ARITHMETIC double sin(double x) { return quarter_turned(x, 0); }
ARITHMETIC double cos(double x) { return quarter_turned(x, 1); }

ARITHMETIC_CALLED double logarithm(double x, double& rest) {
    const double SERIES[7] = {1.0 / 3.0, -0.25, 0.2, -1.0 / 6.0, 1.0 / 7.0, -0.125, 1.0 / 9.0};
    const double TABLE[47][2] = {
        {0.3522205935893521, 5.7233316949182485e-18},
        {0.33024168687057687, -1.0828321637483858e-17},
        {0.3087354816496133, -1.6199186085148102e-17},
        {0.2876820724517809, 2.607160616442564e-17},
        {0.26706278524904525, -7.32891532732017e-18},
        {0.24686007793152578, 1.361743371748368e-17},
        {0.22705745063534608, 9.551415762738488e-18},
        {0.2076393647782445, 1.2053243216686129e-17},
        {0.18859116980755003, -7.432164219196925e-18},
        {0.16989903679539747, -4.868008764439071e-19},
        {0.15154989812720093, 5.1669593684615594e-18},
        {0.13353139262452263, -3.664457663660085e-18},
        {0.1158318155251217, 4.338484369808096e-18},
        {0.09844007281325252, -4.439009633675136e-18},
        {0.0813456394539524, 5.07707635593117e-18},
        {0.06453852113757118, -6.470486661692933e-18},
        {0.048009219186360606, 1.4390903347292205e-18},
        {0.0317486983145803, 3.0382263084680858e-18},
        {0.015748356968139168, 1.0021578630528974e-18},
        {0.0, 0.0},
        {-0.015504186535965254, 3.278321022892429e-19},
        {-0.030771658666753687, -1.0431732029005968e-18},
        {-0.0458095360312942, -1.902959866474257e-18},
        {-0.06062462181643484, -2.6424025938726934e-18},
        {-0.07522342123758753, 5.930604196293241e-18},
        {-0.08961215868968714, 5.4268129336647135e-18},
        {-0.10379679368164356, -5.47772415726659e-18},
        {-0.11778303565638346, 1.1971685747593677e-18},
        {-0.13157635778871926, -1.1123000879729588e-17},
        {-0.1451820098444979, -8.242418783022475e-18},
        {-0.15860503017663857, -1.1257003872182592e-17},
        {-0.17185025692665923, 6.0224538210113705e-18},
        {-0.184922338494012, -3.0236614153574064e-18},
        {-0.19782574332991987, -1.2821194372980142e-17},
        {-0.21056476910734964, 4.249405314729895e-18},
        {-0.22314355131420976, 9.091270597324799e-18},
        {-0.2355660713127669, 2.3943371495187355e-18},
        {-0.24783616390458127, 1.2432209578702523e-17},
        {-0.25995752443692605, -2.069806938978935e-17},
        {-0.27193371548364176, -7.83319637697442e-19},
        {-0.2837681731306446, 2.032665581126656e-17},
        {-0.2954642128938359, 2.16461086040599e-17},
        {-0.3070250352949119, 1.2319916200101964e-17},
        {-0.3184537311185346, -2.7114779367326236e-17},
        {-0.329753286372468, -2.122020616196946e-18},
        {-0.3409265869705932, -1.7467136443544747e-17},
        {-0.3519764231571782, 1.2953893030191963e-17},
    };
    double f;
    double k = (double)split(x, f);
    double m = 1.0 + f;
    double shifted = 64.0 / m + ARITHMETIC_ROUNDING;
    double scale = (shifted - ARITHMETIC_ROUNDING) * (1.0 / 64.0);
    double r_low, square_low, lost_1, lost_2, lost_3;
    double r = two_sum(upper(m) * scale - 1.0, (m - upper(m)) * scale, r_low);
    double square = two_product(r, r, square_low);
    double series = square * r * polynomial(SERIES, r);
    int row = (int)(bits(shifted) - bits(ARITHMETIC_ROUNDING)) - 45;
    double sum = two_sum(k * ARITHMETIC_LN_2_HIGH, TABLE[row][0], lost_1);
    sum = two_sum(sum, r, lost_2);
    sum = two_sum(sum, -0.5 * square, lost_3);
    double tail = TABLE[row][1] + k * ARITHMETIC_LN_2_LOW + (r_low - (0.5 * square_low + r * r_low));
    tail = series + (tail + ((lost_1 + lost_2) + lost_3));
    double high = sum + tail;
    rest = (sum - high) + tail;
    return high;
}
// Whether a number is whole (1: even, 2: odd) or not (0).
ARITHMETIC int whole(double y) {
    double size = magnitude(y);
    if (size >= 9007199254740992.0) return 1;
    uint64_t integer = (uint64_t)size;
    return (double)integer != size ? 0 : (integer & 1) == 1 ? 2 : 1;
}
ARITHMETIC_CALLED double pow(double x, double y) {
    if (y == 0.0 || x == 1.0) return 1.0;
    if (x != x || y != y) return ARITHMETIC_NAN;
    double size = magnitude(x);
    int kind = whole(y);
    double sign = (bits(x) >> 63 == 1 && kind == 2) ? -1.0 : 1.0;
    bool is_infinite = magnitude(y) == ARITHMETIC_INFINITY;
    if (size == 1.0 && is_infinite) return 1.0;
    if (size == 0.0 || size == ARITHMETIC_INFINITY || is_infinite) {
        bool grows = (size > 1.0) == (y > 0.0);
        return sign * (grows ? ARITHMETIC_INFINITY : 0.0);
    }
    if (x < 0.0 && kind == 0) return ARITHMETIC_NAN;
    y = y > 18446744073709551616.0 ? 18446744073709551616.0 : y;
    y = y < -18446744073709551616.0 ? -18446744073709551616.0 : y;
    double low, lost;
    double high = logarithm(size, low);
    double product = two_product(high, y, lost);
    low = lost + y * low;
    if (product > 710.0) return sign * ARITHMETIC_INFINITY;
    if (product < -746.0) return sign * 0.0;
    int32_t n;
    double rest = exp_parts(product, low, n);
    return sign * scaled(1.0 + rest, n);
}
ARITHMETIC double powi(double x, int32_t n) {
    uint32_t b = n < 0 ? 0u - (uint32_t)n : (uint32_t)n;
    double factor = x, product = 1.0;
    while (b != 0) {
        if (b & 1) product *= factor;
        factor *= factor;
        b >>= 1;
    }
    double power = n < 0 ? 1.0 / product : product;
    return power != power ? ARITHMETIC_NAN : power;
}

}  // namespace arithmetic
