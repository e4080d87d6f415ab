// ln Gamma and its derivatives, normal and gamma draws: the modules `gamma`, `draws` and `gamma_slope`.
#pragma once

#include "double.cuh"

namespace arithmetic {

ARITHMETIC double ln_gamma_above_one(double z) {
    const double C[16] = {-0.3930873456872526, 0.6625352492439489, -0.2554826879616018, 0.1367707934883712, -0.0833925057461147,
        0.05439040174990732, -0.03692956553070066, 0.025743858550162976, -0.018282002489257113,
        0.013163038093112174, -0.009581623724678582, 0.007032775647613247, -0.005150475842701773,
        0.0038290740100617986, -0.0033334654764390617, 0.002504762399546448};
    return z * polynomial(C, z - 0.25);
}
ARITHMETIC double ln_gamma_around_two(double z) {
    const double C[19] = {0.3224670334241132, -0.0673523010531981, 0.020580808427784553, -0.0073855510286719986,
        0.002890510330740574, -0.0011927539118428156, 0.0005096695248097167, -0.00022315475400520507,
        9.94575106565683e-05, -4.49263133791557e-05, 2.0507249390577883e-05, -9.438715099211532e-06,
        4.374497421555722e-06, -2.0439048107029907e-06, 9.573811846241715e-07, -4.3252393445604814e-07,
        2.0408401495663627e-07, -1.3219945666117874e-07, 6.286887600397704e-08};
    return z * (0.42278433509846713 + z * polynomial(C, z));
}
ARITHMETIC_CALLED double ln_gamma(double x) {
    const double STIRLING[8] = {1.0 / 12.0, -1.0 / 360.0, 1.0 / 1260.0, -1.0 / 1680.0, 1.0 / 1188.0, -691.0 / 360360.0, 1.0 / 156.0,
        -3617.0 / 122400.0};
    if (x != x || x <= 0.0) return ARITHMETIC_NAN;
    if (x >= 10.0) {
        double inverse = 1.0 / x;
        return (x - 0.5) * (ln(x) - 1.0) + (0.4189385332046727 + inverse * polynomial(STIRLING, inverse * inverse));
    }
    if (x < 0.5) return ln_gamma_above_one(x) - ln(x);
    if (x < 1.0) return ln_gamma_around_two(x - 1.0) - ln(x);
    if (x < 1.5) return ln_gamma_above_one(x - 1.0);
    double argument = x, factor = 1.0;
    while (argument > 2.5) {
        argument -= 1.0;
        factor *= argument;
    }
    return ln_gamma_around_two(argument - 2.0) + ln(factor);
}
ARITHMETIC double digamma_above_one(double y) {
    const double C[23] = {0.9510558760318328, -0.4236274212814606, 0.24054248424078697, -0.14840492305388092, 0.09498872445289039,
        -0.06192213327548831, 0.040760833940846085, -0.026975796659787055, 0.017907248317313294,
        -0.011908220105959716, 0.007927021796868154, -0.005279937255532708, 0.003518106563802472,
        -0.0023454947397380833, 0.0015633696313653504, -0.0010364584817312839, 0.0006909255761282986,
        -0.00048595039220036254, 0.00032395945401345196, -0.00014480643368061614, 9.653646261410062e-05,
        -0.0001782188548855923, 0.00011881232908510335};
    return ((y - 0.46163214496836236) - -1.5522348162858677e-17) * polynomial(C, y - 0.5);
}
ARITHMETIC_CALLED double digamma(double x) {
    const double DIGAMMA[8] = {1.0 / 12.0, -1.0 / 120.0, 1.0 / 252.0, -1.0 / 240.0, 1.0 / 132.0, -691.0 / 32760.0, 1.0 / 12.0,
        -3617.0 / 8160.0};
    if (x != x || x <= 0.0) return ARITHMETIC_NAN;
    if (x >= 10.0) {
        double inverse = 1.0 / x;
        double square = inverse * inverse;
        return ln(x) - (0.5 * inverse + square * polynomial(DIGAMMA, square));
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
ARITHMETIC_CALLED double trigamma(double x) {
    const double TRIGAMMA[9] = {1.0 / 6.0, -1.0 / 30.0, 1.0 / 42.0, -1.0 / 30.0, 5.0 / 66.0, -691.0 / 2730.0, 7.0 / 6.0, -3617.0 / 510.0,
        43867.0 / 798.0};
    if (x != x || x <= 0.0) return ARITHMETIC_NAN;
    double argument = x, below = 0.0;
    if (x < 10.0) {
        below = 1.0 / x;
        below *= below;
        argument = x + 1.0;
        double numerator = 0.0, denominator = 1.0;
        while (argument < 10.0) {
            double square = argument * argument;
            numerator = numerator * square + denominator;
            denominator *= square;
            argument += 1.0;
        }
        below += numerator / denominator;
    }
    double inverse = 1.0 / argument;
    double square = inverse * inverse;
    return below + (inverse + square * (0.5 + inverse * polynomial(TRIGAMMA, square)));
}

#define ARITHMETIC_GOLDEN 0x9e3779b97f4a7c15ull

ARITHMETIC uint64_t mix(uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return z ^ (z >> 31);
}
struct Stream {
    uint64_t state;
    ARITHMETIC_MEMBER uint64_t word() {
        state += ARITHMETIC_GOLDEN;
        return mix(state);
    }
};

ARITHMETIC double uniform(uint64_t word) { return ((double)(word >> 12) + 0.5) * (1.0 / 4503599627370496.0); }

ARITHMETIC double normal(uint64_t word) {
    const double CENTRE[8] = {3.387132872796366608, 133.14166789178437745, 1971.5909503065514427, 13731.693765509461125,
        45921.953931549871457, 67265.770927008700853, 33430.575583588128105, 2509.0809287301226727};
    const double CENTRE_BELOW[8] = {1.0, 42.313330701600911252, 687.1870074920579083, 5394.1960214247511077, 21213.794301586595867,
        39307.89580009271061, 28729.085735721942674, 5226.495278852854561};
    const double FLANK[8] = {1.42343711074968357734, 4.6303378461565452959, 5.7694972214606914055, 3.64784832476320460504,
        1.27045825245236838258, 0.24178072517745061177, 0.0227238449892691845833, 0.000774545014278341407640};
    const double FLANK_BELOW[8] = {1.0, 2.05319162663775882187, 1.6763848301838038494, 0.68976733498510000455, 0.14810397642748007459,
        0.0151986665636164571966, 0.000547593808499534494600, 0.00000000105075007164441684324};
    const double TAIL[8] = {6.6579046435011037772, 5.4637849111641143699, 1.7848265399172913358, 0.29656057182850489123,
        0.026532189526576123093, 0.0012426609473880784386, 0.0000271155556874348757815,
        0.000000201033439929228813265};
    const double TAIL_BELOW[8] = {1.0, 0.59983220655588793769, 0.13692988092273580531, 0.0148753612908506148525, 0.00078686913114561325910,
        0.0000184631831751005468180, 0.000000142151175831644588870, 0.00000000000000204426310338993978564};
    double probability = uniform(word);
    double q = probability - 0.5;
    if (magnitude(q) <= 0.425) {
        double r = 0.180625 - q * q;
        return q * (polynomial(CENTRE, r) / polynomial(CENTRE_BELOW, r));
    }
    double tail = q < 0.0 ? probability : 1.0 - probability;
    double s = sqrt(-ln(tail));
    double size = s <= 5.0 ? polynomial(FLANK, s - 1.6) / polynomial(FLANK_BELOW, s - 1.6)
                           : polynomial(TAIL, s - 5.0) / polynomial(TAIL_BELOW, s - 5.0);
    return q < 0.0 ? -size : size;
}
ARITHMETIC double log_gamma(double shape, Stream& words) {
    if (!(shape > 0.0 && shape < ARITHMETIC_INFINITY)) return ARITHMETIC_NAN;
    double from_one = shape < 1.0 ? shape + 1.0 : shape;
    double d = from_one - 1.0 / 3.0;
    double c = 1.0 / sqrt(9.0 * d);
    double draw;
    for (;;) {
        double z = normal(words.word());
        double t = 1.0 + c * z;
        if (t <= 0.0) continue;
        double log_cube = 3.0 * ln(t);
        double bound = 0.5 * z * z + d * (1.0 - t * t * t + log_cube);
        if (ln(uniform(words.word())) < bound) {
            draw = ln(d) + log_cube;
            break;
        }
    }
    return shape < 1.0 ? draw + ln(uniform(words.word())) / shape : draw;
}

// Derivative of ln x in `shape` at a fixed probability, of a draw x: the module `gamma_slope`.
ARITHMETIC_CALLED double log_gamma_slope(double shape, double log_draw) {
    if (shape != shape || shape <= 0.0 || log_draw != log_draw) return ARITHMETIC_NAN;
    double draw = exp(log_draw);
    if (shape > 1e6) {
        double distance = (draw - shape) / shape;
        return (1.0 + 0.5 * distance - (distance * distance - 1.0 / shape) / 6.0) / draw;
    }
    if (draw > shape + 2.5 * sqrt(shape) + 2.0) {
        double tail = 0.0, tail_slope = 0.0;
        for (double level = 64.0; level >= 1.0; level -= 1.0) {
            double inverse = 1.0 / (draw + 2.0 * level + 1.0 - shape - tail);
            double numerator = level * (level - shape);
            tail = numerator * inverse;
            tail_slope = (tail * (1.0 + tail_slope) - level) * inverse;
        }
        double fraction = 1.0 / (draw + 1.0 - shape - tail);
        return (log_draw - digamma(shape)) * fraction + fraction * fraction * (1.0 + tail_slope);
    }
    double argument = shape + 1.0, weight = 1.0 / shape;
    double excess = digamma(argument) - log_draw;
    double sum = weight * excess;
    if (draw == 0.0) return sum;
    for (;;) {
        double inverse = 1.0 / argument;
        weight *= draw * inverse;
        excess += inverse;
        double term = weight * excess;
        sum += term;
        if (argument > draw && magnitude(term) < 1e-13 * magnitude(sum) * (1.0 - draw * inverse)) return sum;
        argument += 1.0;
    }
}

}  // namespace arithmetic
