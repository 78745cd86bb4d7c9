/* Directed rounding, as sensor_node/eskin_sensor_node/firmware/rounding.py has it: to the same bit. */
#ifndef ROUNDING_H
#define ROUNDING_H

#include <math.h>
#include <stdint.h>
#include <string.h>

typedef struct {
    double lo, hi;
} bounds_t;

static const double LEAST = 0x1p-1074;
static const double MOST = 0x1.fffffffffffffp+1023;
static const double PHI = 0x1p-53 * (1.0 + 0x1p-52);
static const double SLACK = 0x1p-48;
static const double TWO_PI_LO = 0x1.921fb54442d18p+2;
static const double TWO_PI_HI = 0x1.921fb54442d19p+2;

double down_by_formula(double x);
double up_by_formula(double x);
double divide(double a, double b);

static inline uint64_t bits_of(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline double real_of(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* Comparisons of numbers, without a call: a sign and a pattern tell. */
static inline int at_least_zero(double x) { return (int64_t)bits_of(x) >= 0 || bits_of(x) << 1 == 0; }

static inline int64_t order_of(double x)
{
    int64_t bits = (int64_t)bits_of(x);
    return bits >= 0 ? bits : INT64_MIN - bits;
}

static inline int less(double a, double b) { return order_of(a) < order_of(b); }

/* As Python's max and min: the first one, unless the other one is really greater or less. */
static inline double most_of(double a, double b) { return less(a, b) ? b : a; }
static inline double least_of(double a, double b) { return less(b, a) ? b : a; }

/* From 2^-967 to infinity the formula gives the neighbour of x, one step of its pattern away. */
static inline int steps_by_pattern(uint64_t bits)
{
    const uint32_t first = 1023 - 967, last = 0x7ff;
    return ((uint32_t)(bits >> 52) & last) - first < last - first;
}

static inline double down(double x)
{
    uint64_t bits = bits_of(x);
    if (!steps_by_pattern(bits))
        return down_by_formula(x);
    return real_of(bits + ((int64_t)bits < 0 ? 1 : -1));
}

static inline double up(double x)
{
    uint64_t bits = bits_of(x);
    if (!steps_by_pattern(bits))
        return up_by_formula(x);
    return real_of(bits + ((int64_t)bits < 0 ? -1 : 1));
}

#endif
