/* How a patch's samples are written: sensor_node/eskin_sensor_node/firmware/sample_codec.py. */
#include "channel.h"

enum { MOST_CELLS = 4096, GROUP = 64, MODULUS = 1 << 24, HALF = MODULUS / 2 };
enum { UNKNOWN, NO_LOWER, NO_UPPER, BOUNDED };
enum { FINEST = -1000, MOST_SPAN = MODULUS - 1 - BOUNDED };
static const double FAR = 0x1p+950;
static const uint64_t HIDDEN = 1ULL << 52;

static bounds_t within_reach(double lo, double hi)
{
    return (bounds_t){less(lo, -FAR) ? -INFINITY : least_of(lo, FAR),
                      less(FAR, hi) ? INFINITY : most_of(hi, -FAR)};
}

static int exponent_of(double x) { return (int)(bits_of(x) >> 52) & 0x7ff; }

static int is_finite(double x) { return exponent_of(x) != 0x7ff; }

/* The greatest number of quanta that is not above x: a shift, where x is normal. */
static int64_t quanta_down(double x, int exponent)
{
    uint64_t bits = bits_of(x);
    int shift = exponent - exponent_of(x) + 1075;
    if (exponent_of(x) == 0 || shift < -9) {
        int64_t quanta = (int64_t)floor(ldexp(x, -exponent));
        return less(x, ldexp((double)quanta, exponent)) ? quanta - 1 : quanta;
    }
    int64_t whole = (int64_t)((bits & (HIDDEN - 1)) | HIDDEN);
    whole = (int64_t)bits < 0 ? -whole : whole;
    return shift < 0 ? whole * (1 << -shift) : whole >> (shift < 63 ? shift : 63);
}

static int exponent_for(double size, int bits)
{
    int exponent;
    if (!less(0.0, size))
        return FINEST;
    frexp(size, &exponent);
    return exponent - bits;
}

static int greater(int a, int b) { return a > b ? a : b; }

static void find_scale(encoded_t *encoded, const double *lows, const double *highs, int n, int finest)
{
    double lowest = INFINITY, highest = -INFINITY;
    for (int k = 0; k < n; k++) {
        bounds_t x = within_reach(lows[k], highs[k]);
        if (is_finite(x.lo))
            lowest = least_of(lowest, x.lo), highest = most_of(highest, x.lo);
        if (is_finite(x.hi))
            lowest = least_of(lowest, x.hi), highest = most_of(highest, x.hi);
    }
    encoded->exponent = finest, encoded->offset = 0;
    if (less(highest, lowest))
        return;
    int exponent = greater(finest, exponent_for(most_of(fabs(lowest), fabs(highest)), 52));
    exponent = greater(exponent, exponent_for(highest - lowest, 24));
    while (-quanta_down(-highest, exponent) - quanta_down(lowest, exponent) > MOST_SPAN)
        exponent += 1;
    encoded->exponent = exponent, encoded->offset = quanta_down(lowest, exponent);
}

/* Cells from a first one on, each predicted by the one so many cells before it. */
static uint8_t *pack(const int32_t *codes, int first, int cells, int before, uint8_t *out)
{
    for (int begin = first; begin < cells; begin += GROUP) {
        uint32_t folded[GROUP], bits = 0;
        int size = cells - begin < GROUP ? cells - begin : GROUP;
        for (int k = 0; k < size; k++) {
            int cell = begin + k;
            int32_t step = codes[cell] - (cell < before ? 0 : codes[cell - before]);
            step = (int32_t)(((uint32_t)step + HALF) & (MODULUS - 1)) - HALF;
            folded[k] = (uint32_t)(step >= 0 ? 2 * step : -2 * step - 1);
            bits |= folded[k];
        }
        int width = bits ? 32 - __builtin_clz(bits) : 0, filled = 0;
        uint32_t held = 0;
        *out++ = (uint8_t)width;
        for (int k = 0; k < size; k++) {
            held |= folded[k] << filled;
            for (filled += width; filled >= 8; filled -= 8, held >>= 8)
                *out++ = (uint8_t)held;
        }
        if (filled)
            *out++ = (uint8_t)held;
    }
    return out;
}

encoded_t encode_samples(const double *lows, const double *highs, int rows, int columns, int finest,
                         uint8_t *out)
{
    static int32_t bases[MOST_CELLS], widths[MOST_CELLS];
    int cells = rows * columns;
    encoded_t encoded;
    find_scale(&encoded, lows, highs, cells, finest);
    for (int k = 0; k < cells; k++) {
        bounds_t x = within_reach(lows[k], highs[k]);
        int has_lower = is_finite(x.lo), has_upper = is_finite(x.hi);
        int before = k < columns ? 1 : columns;
        int64_t low = has_lower ? quanta_down(x.lo, encoded.exponent) - encoded.offset : 0;
        int64_t high = has_upper ? -quanta_down(-x.hi, encoded.exponent) - encoded.offset : 0;
        bases[k] = has_lower ? low : has_upper ? high : k < before ? 0 : bases[k - before];
        widths[k] = !has_lower ? (has_upper ? NO_LOWER : UNKNOWN)
                               : has_upper ? BOUNDED + high - low : NO_UPPER;
    }
    uint8_t *end = pack(bases, 0, columns, 1, out);
    end = pack(bases, columns, cells, columns, end);
    end = pack(widths, 0, columns, 1, end);
    end = pack(widths, columns, cells, columns, end);
    encoded.length = end - out;
    return encoded;
}
