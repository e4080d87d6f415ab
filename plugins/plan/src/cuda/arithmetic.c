// The crate `arithmetic`, operation by operation. Nothing is contracted: the compilers get `--fmad=false` and
// `-ffp-contract=off`, and a fused multiply-add is written as `fmaf`.

#define NOT_A_NUMBER float_of(0x7fc00000u)
#define NOT_A_DOUBLE double_of(0x7ff8000000000000ull)
#define INFINITE float_of(0x7f800000u)
#define INFINITE_DOUBLE double_of(0x7ff0000000000000ull)
#define LEAST_NORMAL float_of(0x00800000u)

FUNCTION float horner(const float *c, int n, float x) {
    float sum = c[n - 1];
    UNROLL for (int i = n - 2; i >= 0; i--) sum = sum * x + c[i];
    return sum;
}

FUNCTION double wide_horner(const double *c, int n, double x) {
    double sum = c[n - 1];
    UNROLL for (int i = n - 2; i >= 0; i--) sum = sum * x + c[i];
    return sum;
}

#define POLYNOMIAL(c, x) horner(c, (int)(sizeof(c) / sizeof((c)[0])), x)
#define WIDE_POLYNOMIAL(c, x) wide_horner(c, (int)(sizeof(c) / sizeof((c)[0])), x)

// --- f32 ---

#define ROUNDING 12582912.0f
#define LN_2_HIGH (355.0f / 512.0f)
#define LN_2_LOW (-0.00021219444f)

FUNCTION float held(float x, float low, float high) {
    x = x < low ? low : x;
    return x > high ? high : x;
}

FUNCTION float known(float x, float y) { return x != x ? NOT_A_NUMBER : y; }

FUNCTION float power_of_two(int n) { return float_of((u32)(n + 127) << 23); }

FUNCTION float exp_parts(float x, int *n) {
    const float c[6] = {0.5f, 0.16666667f, 0.041666467f, 0.0083333105f, 0.001393365f, 0.00019890991f};
    const float shifted = x * 1.4426950408889634f + ROUNDING;
    const float whole = shifted - ROUNDING;
    const float r = (x - whole * LN_2_HIGH) - whole * LN_2_LOW;
    *n = (int)(bits_of(shifted) - bits_of(ROUNDING));
    return 1.0f + (r + r * r * POLYNOMIAL(c, r));
}

FUNCTION float ln_parts(float k, float f, float correction) {
    const float c[9] = {0.3333333f,   -0.24999997f, 0.20000716f,  -0.16667798f, 0.14249034f,
                        -0.12425794f, 0.116858006f, -0.11479056f, 0.06969562f};
    const float square = f * f;
    const float cubic = square * f * POLYNOMIAL(c, f);
    const float rest = (cubic + (k * LN_2_LOW + correction)) - 0.5f * square;
    return (f + rest) + k * LN_2_HIGH;
}

FUNCTION int split(float x, float *f) {
    const u32 bits = bits_of(x) + (0x3f800000u - 0x3f3504f3u);
    *f = float_of((bits & 0x007fffffu) + 0x3f3504f3u) - 1.0f;
    return (int)(bits >> 23) - 127;
}

FUNCTION float exp_f(float x) {
    int n;
    const float factor = exp_parts(held(x, -104.0f, 89.0f), &n);
    const int half = n >> 1;
    return known(x, factor * power_of_two(half) * power_of_two(n - half));
}

FUNCTION float ln_f(float x) {
    float f;
    const int is_small = x < LEAST_NORMAL;
    int k = split(is_small ? x * 8388608.0f : x, &f);
    k = is_small ? k - 23 : k;
    float inside = ln_parts((float)k, f, 0.0f);
    inside = x == INFINITE ? x : inside;
    const float at_most_zero = x == 0.0f ? -INFINITE : NOT_A_NUMBER;
    return x > 0.0f ? inside : at_most_zero;
}

FUNCTION float ln_1p_f(float x) {
    float f;
    const float sum = 1.0f + x;
    const float lost = x < 1.0f ? x - (sum - 1.0f) : 1.0f - (sum - x);
    const int k = split(sum, &f);
    const float correction = k == 0 ? 0.0f : lost / sum;
    f = k == 0 ? x : f;
    float inside = ln_parts((float)k, f, correction);
    inside = (x == INFINITE || x == 0.0f) ? x : inside;
    const float outside = x == -1.0f ? -INFINITE : NOT_A_NUMBER;
    return x > -1.0f ? inside : outside;
}

FUNCTION float with_sign(float size, float x) {
    return float_of((bits_of(size) & 0x7fffffffu) | (bits_of(x) & 0x80000000u));
}

FUNCTION float size_of(float x) { return float_of(bits_of(x) & 0x7fffffffu); }

FUNCTION float tanh_f(float x) {
    const float c[6] = {-0.33333334f, 0.13333304f, -0.053959258f, 0.021768918f, -0.008343945f, 0.0022927448f};
    int n;
    const float magnitude = held(size_of(x), 0.0f, 9.1f);
    const float factor = exp_parts(2.0f * magnitude, &n);
    const float large = 1.0f - 2.0f / (factor * power_of_two(n) + 1.0f);
    const float square = magnitude * magnitude;
    const float small = magnitude + magnitude * (square * POLYNOMIAL(c, square));
    return known(x, with_sign(magnitude < 0.625f ? small : large, x));
}

FUNCTION float sigmoid_f(float x) {
    const float tail = exp_f(-size_of(x));
    return known(x, (x < 0.0f ? tail : 1.0f) / (1.0f + tail));
}

FUNCTION float softplus_f(float x) {
    const float tail = exp_f(-size_of(x));
    const float k = tail >= 0.4142135f ? 1.0f : 0.0f;
    const float less = tail - k;
    const float lost = tail - (less + k);
    const float rest = ln_parts(k, (1.0f - 0.5f * k) * less, 0.6866f * lost);
    return known(x, (x > 0.0f ? x : 0.0f) + rest);
}

// --- f64 ---

#define WIDE_ROUNDING 6755399441055744.0
#define WIDE_LN_2_HIGH 0.693147180559663
#define WIDE_LN_2_LOW 2.8235290563031577e-13

FUNCTION double wide_held(double x, double low, double high) {
    x = x < low ? low : x;
    return x > high ? high : x;
}

FUNCTION double wide_power_of_two(int n) { return double_of((u64)((long long)n + 1023) << 52); }

FUNCTION double wide_scaled(double y, int n) {
    const int half = n >> 1;
    return y * wide_power_of_two(half) * wide_power_of_two(n - half);
}

FUNCTION double wide_exp(double x) {
    const double c[11] = {0.5,
                          0.1666666666666667,
                          0.04166666666666667,
                          0.008333333333326136,
                          0.0013888888888883748,
                          0.00019841269874820627,
                          2.4801587325547743e-05,
                          2.7557255400206422e-06,
                          2.75572736431103e-07,
                          2.5105217004720745e-08,
                          2.0914686968086876e-09};
    const double inside = wide_held(x, -746.0, 710.0);
    const double shifted = inside * 1.4426950408889634 + WIDE_ROUNDING;
    const double n = shifted - WIDE_ROUNDING;
    const double high = inside - n * WIDE_LN_2_HIGH, low = n * WIDE_LN_2_LOW - 0.0;
    const double r = high - low;
    const double lost = (high - r) - low;
    const int whole = (int)(long long)(wide_bits_of(shifted) - wide_bits_of(WIDE_ROUNDING));
    const double rest = r + (r * r * WIDE_POLYNOMIAL(c, r) + lost);
    return x != x ? NOT_A_DOUBLE : wide_scaled(1.0 + rest, whole);
}

FUNCTION double wide_ln(double x) {
    const double c[8] = {0.6666666666666666,  0.4000000000000088,  0.28571428570801954, 0.22222222392089008,
                         0.18181795600060793, 0.15386241881938595, 0.13268714792348096, 0.1308723619665962};
    if (!(x > 0.0 && x < INFINITE_DOUBLE)) {
        return x == 0.0 ? -INFINITE_DOUBLE : x == INFINITE_DOUBLE ? x : NOT_A_DOUBLE;
    }
    const u64 root = 0x3fe6a09e667f3bcdull;
    const int is_small = x < double_of(0x0010000000000000ull);
    const u64 bits = wide_bits_of(is_small ? x * 18014398509481984.0 : x) + (0x3ff0000000000000ull - root);
    const double k = (double)((long long)(bits >> 52) - 1023 - (is_small ? 54 : 0));
    const double f = double_of((bits & 0x000fffffffffffffull) + root) - 1.0;
    const double s = f / (2.0 + f);
    const double z = s * s, half = 0.5 * f * f;
    const double series = s * (half + z * WIDE_POLYNOMIAL(c, z));
    return k * WIDE_LN_2_HIGH - ((half - (series + (k * WIDE_LN_2_LOW + 0.0))) - f);
}

FUNCTION double ln_gamma_above_one(double z) {
    const double c[16] = {-0.3930873456872526,  0.6625352492439489,  -0.2554826879616018,  0.1367707934883712,
                          -0.0833925057461147,  0.05439040174990732, -0.03692956553070066, 0.025743858550162976,
                          -0.018282002489257113, 0.013163038093112174, -0.009581623724678582, 0.007032775647613247,
                          -0.005150475842701773, 0.0038290740100617986, -0.0033334654764390617, 0.002504762399546448};
    return z * WIDE_POLYNOMIAL(c, z - 0.25);
}

FUNCTION double ln_gamma_around_two(double z) {
    const double c[19] = {0.3224670334241132,     -0.0673523010531981,    0.020580808427784553,   -0.0073855510286719986,
                          0.002890510330740574,   -0.0011927539118428156, 0.0005096695248097167,  -0.00022315475400520507,
                          9.94575106565683e-05,   -4.49263133791557e-05,  2.0507249390577883e-05, -9.438715099211532e-06,
                          4.374497421555722e-06,  -2.0439048107029907e-06, 9.573811846241715e-07, -4.3252393445604814e-07,
                          2.0408401495663627e-07, -1.3219945666117874e-07, 6.286887600397704e-08};
    return z * (0.42278433509846713 + z * WIDE_POLYNOMIAL(c, z));
}

FUNCTION double ln_gamma(double x) {
    const double c[8] = {1.0 / 12.0,   -1.0 / 360.0,       1.0 / 1260.0, -1.0 / 1680.0,
                         1.0 / 1188.0, -691.0 / 360360.0, 1.0 / 156.0,  -3617.0 / 122400.0};
    if (x != x || x <= 0.0) return NOT_A_DOUBLE;
    if (x >= 10.0) {
        const double inverse = 1.0 / x;
        return (x - 0.5) * (wide_ln(x) - 1.0) +
               (0.4189385332046727 + inverse * WIDE_POLYNOMIAL(c, inverse * inverse));
    }
    if (x < 0.5) return ln_gamma_above_one(x) - wide_ln(x);
    if (x < 1.0) return ln_gamma_around_two(x - 1.0) - wide_ln(x);
    if (x < 1.5) return ln_gamma_above_one(x - 1.0);
    double argument = x, factor = 1.0;
    while (argument > 2.5) {
        argument -= 1.0;
        factor *= argument;
    }
    return ln_gamma_around_two(argument - 2.0) + wide_ln(factor);
}

FUNCTION double digamma_above_one(double y) {
    const double c[23] = {0.9510558760318328,     -0.4236274212814606,    0.24054248424078697,    -0.14840492305388092,
                          0.09498872445289039,    -0.06192213327548831,   0.040760833940846085,   -0.026975796659787055,
                          0.017907248317313294,   -0.011908220105959716,  0.007927021796868154,   -0.005279937255532708,
                          0.003518106563802472,   -0.0023454947397380833, 0.0015633696313653504,  -0.0010364584817312839,
                          0.0006909255761282986,  -0.00048595039220036254, 0.00032395945401345196, -0.00014480643368061614,
                          9.653646261410062e-05,  -0.0001782188548855923, 0.00011881232908510335};
    return ((y - 0.46163214496836236) - (-1.5522348162858677e-17)) * WIDE_POLYNOMIAL(c, y - 0.5);
}

FUNCTION double digamma(double x) {
    const double c[8] = {1.0 / 12.0, -1.0 / 120.0,      1.0 / 252.0, -1.0 / 240.0,
                         1.0 / 132.0, -691.0 / 32760.0, 1.0 / 12.0,  -3617.0 / 8160.0};
    if (x != x || x <= 0.0) return NOT_A_DOUBLE;
    if (x >= 10.0) {
        const double inverse = 1.0 / x;
        const double square = inverse * inverse;
        return wide_ln(x) - (0.5 * inverse + square * WIDE_POLYNOMIAL(c, square));
    }
    if (x < 1.0) return digamma_above_one(x) - 1.0 / x;
    double argument = x, numerator = 0.0, denominator = 1.0;
    while (argument > 2.0) {
        argument -= 1.0;
        numerator = numerator * argument + denominator;
        denominator *= argument;
    }
    return digamma_above_one(argument - 1.0) + numerator / denominator;
}

FUNCTION double trigamma(double x) {
    const double c[9] = {1.0 / 6.0,        -1.0 / 30.0, 1.0 / 42.0,       -1.0 / 30.0,       5.0 / 66.0,
                         -691.0 / 2730.0, 7.0 / 6.0,   -3617.0 / 510.0, 43867.0 / 798.0};
    if (x != x || x <= 0.0) return NOT_A_DOUBLE;
    double argument = x, below = 0.0;
    if (x < 10.0) {
        below = 1.0 / x;
        below *= below;
        argument = x + 1.0;
        double numerator = 0.0, denominator = 1.0;
        while (argument < 10.0) {
            const double square = argument * argument;
            numerator = numerator * square + denominator;
            denominator *= square;
            argument += 1.0;
        }
        below += numerator / denominator;
    }
    const double inverse = 1.0 / argument;
    const double square = inverse * inverse;
    return below + (inverse + square * (0.5 + inverse * WIDE_POLYNOMIAL(c, square)));
}

// --- Draws ---

#define GOLDEN 0x9e3779b97f4a7c15ull

FUNCTION u64 mix(u64 z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return z ^ (z >> 31);
}

FUNCTION u64 stream_of(u64 seed, u64 index, int entry) {
    return mix(mix(seed + index * GOLDEN) + (u64)(entry + 1) * GOLDEN);
}

FUNCTION u64 word(u64 *stream) {
    *stream += GOLDEN;
    return mix(*stream);
}

FUNCTION double uniform(u64 bits) { return ((double)(bits >> 12) + 0.5) * 2.220446049250313e-16; }

FUNCTION double quantile(double probability) {
    const double centre[2][8] = {
        {3.3871328727963665, 133.14166789178438, 1971.5909503065513, 13731.69376550946, 45921.95393154987,
         67265.7709270087, 33430.57558358813, 2509.0809287301227},
        {1.0, 42.31333070160091, 687.1870074920579, 5394.196021424751, 21213.794301586597, 39307.89580009271,
         28729.085735721943, 5226.495278852854}};
    const double flank[2][8] = {
        {1.4234371107496835, 4.630337846156546, 5.769497221460691, 3.6478483247632045, 1.2704582524523684,
         0.2417807251774506, 0.022723844989269184, 0.0007745450142783414},
        {1.0, 2.053191626637759, 1.6763848301838038, 0.6897673349851, 0.14810397642748008, 0.015198666563616457,
         0.0005475938084995345, 1.0507500716444169e-09}};
    const double tails[2][8] = {
        {6.657904643501103, 5.463784911164114, 1.7848265399172913, 0.29656057182850487, 0.026532189526576124,
         0.0012426609473880784, 2.7115555687434876e-05, 2.0103343992922881e-07},
        {1.0, 0.599832206555888, 0.1369298809227358, 0.014875361290850615, 0.0007868691311456133,
         1.8463183175100548e-05, 1.421511758316446e-07, 2.0442631033899397e-15}};
    const double q = probability - 0.5;
    if ((q < 0.0 ? -q : q) <= 0.425) {
        const double x = 0.180625 - q * q;
        return q * (WIDE_POLYNOMIAL(centre[0], x) / WIDE_POLYNOMIAL(centre[1], x));
    }
    const double tail = q < 0.0 ? probability : 1.0 - probability;
    const double s = sqrt(-wide_ln(tail));
    const double size = s <= 5.0 ? WIDE_POLYNOMIAL(flank[0], s - 1.6) / WIDE_POLYNOMIAL(flank[1], s - 1.6)
                                 : WIDE_POLYNOMIAL(tails[0], s - 5.0) / WIDE_POLYNOMIAL(tails[1], s - 5.0);
    return q < 0.0 ? -size : size;
}

FUNCTION double normal(u64 bits) { return quantile(uniform(bits)); }

FUNCTION float uniform_f(u64 bits) {
    const float nearest = (float)uniform(bits);
    return nearest < 1.0f ? nearest : 0.99999994f;
}

FUNCTION double log_gamma_from_one(double shape, u64 *stream) {
    const double d = shape - 1.0 / 3.0;
    const double c = 1.0 / sqrt(9.0 * d);
    for (;;) {
        const double z = normal(word(stream));
        const double t = 1.0 + c * z;
        if (t <= 0.0) continue;
        const double log_cube = 3.0 * wide_ln(t);
        const double bound = 0.5 * z * z + d * (1.0 - t * t * t + log_cube);
        if (wide_ln(uniform(word(stream))) < bound) return wide_ln(d) + log_cube;
    }
}

FUNCTION double log_gamma_draw(double shape, u64 stream) {
    if (!(shape > 0.0 && shape < INFINITE_DOUBLE)) return NOT_A_DOUBLE;
    if (shape < 1.0) {
        const double above = log_gamma_from_one(shape + 1.0, &stream);
        return above + wide_ln(uniform(word(&stream))) / shape;
    }
    return log_gamma_from_one(shape, &stream);
}

FUNCTION double log_gamma_slope(double shape, double log_draw) {
    if (shape != shape || shape <= 0.0 || log_draw != log_draw) return NOT_A_DOUBLE;
    const double draw = wide_exp(log_draw);
    if (shape > 1e6) {
        const double distance = (draw - shape) / shape;
        return (1.0 + 0.5 * distance - (distance * distance - 1.0 / shape) / 6.0) / draw;
    }
    if (draw > shape + 2.5 * sqrt(shape) + 2.0) {
        double tail = 0.0, tail_slope = 0.0;
        for (double level = 64.0; level >= 1.0; level -= 1.0) {
            const double inverse = 1.0 / (draw + 2.0 * level + 1.0 - shape - tail);
            const double numerator = level * (level - shape);
            tail = numerator * inverse;
            tail_slope = (tail * (1.0 + tail_slope) - level) * inverse;
        }
        const double fraction = 1.0 / (draw + 1.0 - shape - tail);
        const double fraction_slope = fraction * fraction * (1.0 + tail_slope);
        return (log_draw - digamma(shape)) * fraction + fraction_slope;
    }
    double argument = shape + 1.0, weight = 1.0 / shape;
    double excess = digamma(argument) - log_draw;
    double sum = weight * excess;
    if (draw == 0.0) return sum;
    for (;;) {
        const double inverse = 1.0 / argument;
        weight *= draw * inverse;
        excess += inverse;
        const double term = weight * excess;
        sum += term;
        const double term_size = term < 0.0 ? -term : term, sum_size = sum < 0.0 ? -sum : sum;
        if (argument > draw && term_size < 1e-13 * sum_size * (1.0 - draw * inverse)) return sum;
        argument += 1.0;
    }
}
