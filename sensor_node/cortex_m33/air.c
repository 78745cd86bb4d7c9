/* Temperature, humidity, and what the air makes of a pad: inversion/thermometer.py, hygrometer.py
 * and pad.py of sensor_node/eskin_sensor_node/firmware. */
#include "inversion.h"

static const double A = 39083.0 / 10000000, B = -5775.0 / 10000000000, C = -4183.0 / 1000000000000000;
enum { ROUNDS = 3 };

static bounds_t root_bounds(double y)
{
    double t = divide(2.0 * y, A + sqrt(A * A + 4.0 * B * y)), slack = SLACK * fabs(t);
    return (bounds_t){down(t - slack), up(t + slack)};
}

static double cubic(double t) { return -C * (t - 100.0) * t * t * t; }

static bounds_t celsius_bounds(double y)
{
    if (less(y, -0.8))
        return (bounds_t){-INFINITY, -190.0};
    if (less(2.9, y))
        return (bounds_t){840.0, INFINITY};
    bounds_t t = root_bounds(y);
    if (less(t.lo, 0.0))
        for (int k = 0; k < ROUNDS; k++) {
            double most = cubic(t.lo);
            t.hi = root_bounds(up(y + up(most + SLACK * most))).hi;
            double least = cubic(least_of(t.hi, 0.0));
            t.lo = root_bounds(down(y + down(least - SLACK * least))).lo;
        }
    return t;
}

static bounds_t excess_bounds(bounds_t v, bounds_t divider)
{
    bounds_t found = {-INFINITY, INFINITY};
    if (less(-INFINITY, v.lo)) {
        double lo = least_of(most_of(v.lo, 0.0), 1.0);
        found.lo = !less(lo, 1.0) ? INFINITY : down(down(divider.lo * down(divide(lo, up(1.0 - lo)))) - 1.0);
    }
    if (less(v.hi, 1.0)) {
        double hi = most_of(v.hi, 0.0);
        found.hi = up(up(divider.hi * up(divide(hi, down(1.0 - hi)))) - 1.0);
    }
    return found;
}

bounds_t temperature_bounds(int code, int last, const adc_t *adc, double reach, bounds_t divider,
                            bounds_t tolerance)
{
    bounds_t y = excess_bounds(code_bounds(code, last, adc, reach), divider);
    double lo = celsius_bounds(y.lo).lo, hi = celsius_bounds(y.hi).hi;
    return (bounds_t){down(lo - up(tolerance.lo + up(tolerance.hi * fabs(lo)))),
                      up(hi + up(tolerance.lo + up(tolerance.hi * fabs(hi))))};
}

static bounds_t humidity_bounds(bounds_t c, bounds_t rest, bounds_t sensitivity, double error)
{
    bounds_t found = {-INFINITY, INFINITY};
    if (less(-INFINITY, c.lo)) {
        double change = down(down(divide(c.lo, rest.hi)) - 1.0);
        change = down(divide(change, at_least_zero(change) ? sensitivity.hi : sensitivity.lo));
        found.lo = most_of(down(down(change + 50.0) - error), 0.0);
    }
    if (less(c.hi, INFINITY)) {
        double change = up(up(divide(c.hi, rest.lo)) - 1.0);
        change = up(divide(change, at_least_zero(change) ? sensitivity.lo : sensitivity.hi));
        found.hi = least_of(up(up(change + 50.0) + error), 100.0);
    }
    if (less(100.0, found.lo) || less(found.hi, 0.0))
        return (bounds_t){-INFINITY, INFINITY};
    return found;
}

bounds_t moisture_bounds(int code, int last, const adc_t *adc, double reach, bounds_t factor,
                         bounds_t rest, bounds_t sensitivity, double error)
{
    bounds_t c = capacitance_bounds(code_bounds(code, last, adc, reach), factor);
    return humidity_bounds(c, rest, sensitivity, error);
}

void measure_temperature(const input_t *in, bounds_t divider, bounds_t tolerance, buffer_t t)
{
    for (int k = 0; k < in->n; k++) {
        bounds_t found = temperature_bounds(in->codes[k], in->last, &in->adc, in->reach, divider,
                                            tolerance);
        t.lo[k] = found.lo, t.hi[k] = found.hi;
    }
}

void measure_humidity(const input_t *in, bounds_t factor, bounds_t rest, bounds_t sensitivity,
                      double error, buffer_t h)
{
    for (int k = 0; k < in->n; k++) {
        bounds_t found = moisture_bounds(in->codes[k], in->last, &in->adc, in->reach, factor, rest,
                                         sensitivity, error);
        h.lo[k] = found.lo, h.hi[k] = found.hi;
    }
}

static bounds_t change_bounds(bounds_t x, double reference, bounds_t slope)
{
    if (slope.lo == 0.0 && slope.hi == 0.0)
        return (bounds_t){0.0, 0.0};
    double below = down(x.lo - reference), above = up(x.hi - reference);
    if (at_least_zero(slope.lo))
        return (bounds_t){down((at_least_zero(below) ? slope.lo : slope.hi) * below),
                          up((at_least_zero(above) ? slope.hi : slope.lo) * above)};
    return (bounds_t){down((at_least_zero(above) ? slope.lo : slope.hi) * above),
                      up((at_least_zero(below) ? slope.hi : slope.lo) * below)};
}

static int slot_of(const memory_t *memory, int code) { return code % memory->slots; }

static void remember(const memory_t *memory, int code, bounds_t change)
{
    int slot = slot_of(memory, code);
    memory->lows[slot] = change.lo, memory->highs[slot] = change.hi;
    memory->known[slot] = code;
}

static void add(const memory_t *memory, int code, buffer_t k, int sample)
{
    int slot = slot_of(memory, code);
    k.lo[sample] = down(k.lo[sample] + memory->lows[slot]);
    k.hi[sample] = up(k.hi[sample] + memory->highs[slot]);
}

void measure_permittivity(int n, bounds_t stated, buffer_t k)
{
    for (int j = 0; j < n; j++)
        k.lo[j] = stated.lo, k.hi[j] = stated.hi;
}

int measure_thermal_change(const input_t *in, bounds_t divider, bounds_t tolerance, bounds_t slope,
                 const memory_t *memory, buffer_t k)
{
    int new = 0;
    for (int j = 0; j < in->n; j++) {
        int code = in->codes[j];
        if (memory->known[slot_of(memory, code)] != code) {
            bounds_t t = temperature_bounds(code, in->last, &in->adc, in->reach, divider, tolerance);
            remember(memory, code, change_bounds(t, 20.0, slope));
            new += 1;
        }
        add(memory, code, k, j);
    }
    return new;
}

int measure_humidity_change(const input_t *in, bounds_t factor, bounds_t rest, bounds_t sensitivity,
                  double error, bounds_t slope, const memory_t *memory, buffer_t k)
{
    int new = 0;
    for (int j = 0; j < in->n; j++) {
        int code = in->codes[j];
        if (memory->known[slot_of(memory, code)] != code) {
            bounds_t h = moisture_bounds(code, in->last, &in->adc, in->reach, factor, rest,
                                         sensitivity, error);
            remember(memory, code, change_bounds(h, 50.0, slope));
            new += 1;
        }
        add(memory, code, k, j);
    }
    return new;
}
