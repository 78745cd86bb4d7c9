/* How a block's bounds are written: sensor_node/eskin_sensor_node/firmware/encoding.py. */
#include "channel.h"

enum { UNBOUNDED = 65535, MOST_CODE = 65534 };
static const double FAR = 0x1p+1000, MOST_F32 = 0x1.fffffep+127;

/* A difference of infinities is no number, and widens nothing. */
static double wider(double widening, double more)
{
    return less(widening, more) && !less(INFINITY, more) ? more : widening;
}

static void note(written_t *written, double lo, double hi, double low, double high)
{
    written->lowest = least_of(written->lowest, low);
    written->highest = most_of(written->highest, high);
    if (less(-INFINITY, low))
        written->widening = wider(written->widening, lo - low);
    if (less(high, INFINITY))
        written->widening = wider(written->widening, high - hi);
}

static written_t nothing(void) { return (written_t){INFINITY, -INFINITY, 0.0, 0, 0}; }

written_t write_f64(const double *lows, const double *highs, int n, uint8_t *lo, uint8_t *hi)
{
    written_t written = nothing();
    for (int k = 0; k < n; k++) {
        memcpy(lo + 8 * k, lows + k, 8);
        memcpy(hi + 8 * k, highs + k, 8);
        note(&written, lows[k], highs[k], lows[k], highs[k]);
    }
    return written;
}

static float single_of(uint32_t bits)
{
    float x;
    memcpy(&x, &bits, 4);
    return x;
}

static float single_up_by_steps(double value)
{
    if (value > MOST_F32)
        return INFINITY;
    if (value < -MOST_F32)
        return value == -INFINITY ? -INFINITY : (float)-MOST_F32;
    float single = (float)value;
    if (single < value) {
        int32_t bits;
        memcpy(&bits, &single, 4);
        single = single_of(single == 0.0f ? 1 : bits + (bits >= 0 ? 1 : -1));
    }
    return single;
}

/* The least binary32 that is not below a value: where both are normal, what is cut off tells. */
static float single_up(double value)
{
    uint64_t bits = bits_of(value);
    uint32_t exponent = (uint32_t)(bits >> 52) & 0x7ff, sign = (uint32_t)(bits >> 63);
    if (exponent - 897 >= 1150 - 897)
        return single_up_by_steps(value);
    uint32_t single = sign << 31 | (exponent - 896) << 23 | ((uint32_t)(bits >> 29) & 0x7fffff);
    return single_of(single + (!sign && ((uint32_t)bits & 0x1fffffff) != 0));
}

written_t write_f32(const double *lows, const double *highs, int n, uint8_t *lo, uint8_t *hi)
{
    float lowest = INFINITY, highest = -INFINITY;
    double widening = 0.0;
    for (int k = 0; k < n; k++) {
        float low = -single_up(-lows[k]), high = single_up(highs[k]);
        memcpy(lo + 4 * k, &low, 4);
        memcpy(hi + 4 * k, &high, 4);
        lowest = low < lowest ? low : lowest, highest = high > highest ? high : highest;
        if (low > -INFINITY)
            widening = wider(widening, lows[k] - low);
        if (high < INFINITY)
            widening = wider(widening, high - highs[k]);
    }
    return (written_t){lowest, highest, widening, 0, 0};
}

static bounds_t within_reach(double lo, double hi)
{
    return (bounds_t){less(lo, -FAR) ? -INFINITY : least_of(lo, FAR),
                      less(FAR, hi) ? INFINITY : most_of(hi, -FAR)};
}

static int exponent_of(double x) { return (int)(bits_of(x) >> 52) & 0x7ff; }

static int is_finite(double x) { return exponent_of(x) != 0x7ff; }

static const uint64_t HIDDEN = 1ULL << 52;

/* floor(x * 2^-exponent), by a shift where x is normal and the result has less than 63 bits. */
static int64_t scaled_floor(double x, int exponent)
{
    uint64_t bits = bits_of(x);
    int shift = exponent - exponent_of(x) + 1075;
    if (exponent_of(x) == 0 || shift < -9)
        return (int64_t)floor(ldexp(x, -exponent));
    int64_t whole = (int64_t)((bits & (HIDDEN - 1)) | HIDDEN);
    whole = (int64_t)bits < 0 ? -whole : whole;
    return shift < 0 ? whole * (1 << -shift) : whole >> (shift < 63 ? shift : 63);
}

static int64_t scaled_ceil(double x, int exponent) { return -scaled_floor(-x, exponent); }

/* A whole number times 2^exponent, by its digits where both it and the result are normal. */
static double scaled_back(int64_t whole, int exponent)
{
    uint64_t size = whole < 0 ? -(uint64_t)whole : (uint64_t)whole;
    if (size - 1 >= 2 * HIDDEN - 1)
        return ldexp((double)whole, exponent);
    int up_by = __builtin_clzll(size) - 11, field = exponent - up_by + 1075;
    if (field < 1 || field > 2046)
        return ldexp((double)whole, exponent);
    uint64_t bits = ((size << up_by) & (HIDDEN - 1)) | (uint64_t)field << 52;
    return real_of(whole < 0 ? bits | 1ULL << 63 : bits);
}

static int64_t span(double lowest, double highest, int exponent)
{
    return scaled_ceil(highest, exponent) + 1 - (scaled_floor(lowest, exponent) - 1);
}

static void find_scale(written_t *written, const double *lows, const double *highs, int n)
{
    double lowest = INFINITY, highest = -INFINITY;
    for (int k = 0; k < n; k++) {
        bounds_t x = within_reach(lows[k], highs[k]);
        if (is_finite(x.lo))
            lowest = least_of(lowest, x.lo), highest = most_of(highest, x.lo);
        if (is_finite(x.hi))
            lowest = least_of(lowest, x.hi), highest = most_of(highest, x.hi);
    }
    if (lowest > highest)
        return;
    int exponent;
    frexp(most_of(fabs(lowest), fabs(highest)), &exponent);
    exponent = exponent - 53 < -1074 ? -1074 : exponent - 53;
    while (span(lowest, highest, exponent) > MOST_CODE)
        exponent += 1;
    written->exponent = exponent;
    written->offset = scaled_floor(lowest, exponent) - 1;
}

static void put(uint8_t *buffer, int k, int64_t code)
{
    buffer[2 * k] = (uint8_t)code;
    buffer[2 * k + 1] = (uint8_t)(code >> 8);
}

written_t write_q16(const double *lows, const double *highs, int n, uint8_t *lo, uint8_t *hi)
{
    written_t written = nothing();
    find_scale(&written, lows, highs, n);
    int exponent = written.exponent;
    int64_t offset = written.offset;
    for (int k = 0; k < n; k++) {
        bounds_t x = within_reach(lows[k], highs[k]);
        double low = -INFINITY, high = INFINITY;
        int64_t below = UNBOUNDED, above = UNBOUNDED;
        if (is_finite(x.lo)) {
            below = scaled_floor(x.lo, exponent) - offset;
            low = scaled_back(below + offset, exponent);
            if (less(x.lo, low)) {
                below -= 1;
                low = scaled_back(below + offset, exponent);
            }
        }
        if (is_finite(x.hi)) {
            above = scaled_ceil(x.hi, exponent) - offset;
            high = scaled_back(above + offset, exponent);
            if (less(high, x.hi)) {
                above += 1;
                high = scaled_back(above + offset, exponent);
            }
        }
        put(lo, k, below);
        put(hi, k, above);
        note(&written, lows[k], highs[k], low, high);
    }
    return written;
}
