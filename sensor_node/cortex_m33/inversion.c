/* capacitive.py, touch.py, inductive.py, coil.py and codes.py of
 * sensor_node/eskin_sensor_node/firmware/inversion. */
#include "inversion.h"

bounds_t code_bounds(int code, int last, const adc_t *adc, double reach)
{
    double low = down(code - adc->nonlinearity), high = up(code + 1 + adc->nonlinearity);
    bounds_t found = {-INFINITY, INFINITY};
    if (code > 0) {
        double lo = down(low * (at_least_zero(low) ? adc->step_lo : adc->step_hi));
        found.lo = down(down(lo + adc->offset_lo) - reach);
    }
    if (code < last) {
        double hi = up(high * (at_least_zero(high) ? adc->step_hi : adc->step_lo));
        found.hi = up(up(hi + adc->offset_hi) + reach);
    }
    return found;
}

bounds_t scaled(bounds_t x, bounds_t factor)
{
    return (bounds_t){down(x.lo * (at_least_zero(x.lo) ? factor.lo : factor.hi)),
                      up(x.hi * (at_least_zero(x.hi) ? factor.hi : factor.lo))};
}

bounds_t capacitance_bounds(bounds_t current, bounds_t factor)
{
    bounds_t found = {-INFINITY, INFINITY};
    if (less(current.hi, INFINITY))
        found.lo = !less(0.0, current.hi) ? 0.0 : down(divide(factor.lo, current.hi));
    if (!(!less(0.0, current.lo) || !less(0.0, current.hi)))
        found.hi = up(divide(factor.hi, current.lo));
    return found;
}

static inline void put(buffer_t buffer, int k, bounds_t x)
{
    buffer.lo[k] = x.lo;
    buffer.hi[k] = x.hi;
}

static inline bounds_t input(const input_t *in, const int32_t *codes, int k, double reach)
{
    return code_bounds(codes[k], in->last, &in->adc, reach);
}

void measure_amplified(const input_t *in, bounds_t gain, buffer_t x)
{
    for (int k = 0; k < in->n; k++) {
        bounds_t v = input(in, in->codes, k, in->reach);
        x.lo[k] = down(divide(v.lo, at_least_zero(v.lo) ? gain.hi : gain.lo));
        x.hi[k] = up(divide(v.hi, at_least_zero(v.hi) ? gain.lo : gain.hi));
    }
}

void measure_capacitive(const input_t *in, bounds_t factor, buffer_t c, buffer_t i)
{
    for (int k = 0; k < in->n; k++) {
        bounds_t current = input(in, in->codes, k, in->reach);
        put(i, k, current);
        put(c, k, capacitance_bounds(current, factor));
    }
}

void measure_touch(const input_t *in, bounds_t reaches, bounds_t factor, bounds_t area_factor,
                   bounds_t energy_factor, buffer_t a, buffer_t c, buffer_t e)
{
    for (int k = 0; k < in->n; k++) {
        bounds_t found = capacitance_bounds(input(in, in->codes, k, 0.0), factor);
        bounds_t area = scaled(found, area_factor);
        put(a, k, (bounds_t){down(area.lo - reaches.lo), up(area.hi + reaches.lo)});
        found = (bounds_t){down(found.lo - reaches.hi), up(found.hi + reaches.hi)};
        put(c, k, found);
        put(e, k, scaled(found, energy_factor));
    }
}

static bounds_t inductance_bounds(bounds_t f, bounds_t capacitance)
{
    bounds_t found = {0.0, INFINITY};
    if (less(0.0, f.hi)) {
        double omega = up(TWO_PI_HI * f.hi);
        found.lo = down(divide(1.0, up(up(omega * omega) * capacitance.hi)));
    }
    if (less(0.0, f.lo) && less(0.0, f.hi)) {
        double omega = down(TWO_PI_LO * f.lo);
        found.hi = up(divide(1.0, down(down(omega * omega) * capacitance.lo)));
    }
    if (!less(f.hi, INFINITY))
        found.lo = -INFINITY;
    return found;
}

static bounds_t distance_bounds(bounds_t l, const coil_t *coil)
{
    bounds_t found = {-INFINITY, INFINITY};
    double most = up(coil->base.hi - l.lo), least = down(coil->base.lo - l.hi);
    least = down(divide(least, at_least_zero(least) ? coil->change.hi : coil->change.lo));
    most = up(divide(most, at_least_zero(most) ? coil->change.lo : coil->change.hi));
    if (!less(0.0, most) || less(1.0, least))
        return found;
    if (less(-INFINITY, l.lo))
        found.lo = !less(most, 1.0) ? 0.0
                               : most_of(0.0, down(divide(-logarithm(most).hi, coil->damping.hi)));
    if (less(0.0, least))
        found.hi = up(divide(-logarithm(least).lo, coil->damping.lo));
    return found;
}

void measure_inductive(const input_t *in, bounds_t reference, bounds_t capacitance,
                       const coil_t *coil, buffer_t f, buffer_t l, buffer_t d)
{
    for (int k = 0; k < in->n; k++) {
        bounds_t found = scaled(input(in, in->codes, k, in->reach), reference);
        put(f, k, found);
        found = inductance_bounds(found, capacitance);
        put(l, k, found);
        put(d, k, distance_bounds(found, coil));
    }
}

static bounds_t modulus_bounds(bounds_t i, bounds_t q)
{
    double i_least = most_of(most_of(i.lo, -i.hi), 0.0);
    double q_least = most_of(most_of(q.lo, -q.hi), 0.0);
    double i_most = most_of(-i.lo, i.hi), q_most = most_of(-q.lo, q.hi);
    double below = down(down(i_least * i_least) + down(q_least * q_least));
    double above = up(up(i_most * i_most) + up(q_most * q_most));
    return (bounds_t){most_of(down(sqrt(most_of(below, 0.0))), 0.0), up(sqrt(above))};
}

static bounds_t lag_bounds(bounds_t i, bounds_t q)
{
    if (!less(0.0, q.lo))
        return (bounds_t){-INFINITY, INFINITY};
    double least = down(divide(i.lo, at_least_zero(i.lo) ? q.hi : q.lo));
    double most = up(divide(i.hi, at_least_zero(i.hi) ? q.lo : q.hi));
    return (bounds_t){arctangent(least).lo, arctangent(most).hi};
}

void measure_eddy(const input_t *in, const int32_t *quadrature, bounds_t modulus, bounds_t lag,
                  buffer_t a, buffer_t p)
{
    for (int k = 0; k < in->n; k++) {
        bounds_t i = input(in, in->codes, k, in->reach), q = input(in, quadrature, k, in->reach);
        bounds_t found = modulus_bounds(i, q);
        a.lo[k] = most_of(down(found.lo * modulus.lo), 0.0);
        a.hi[k] = up(found.hi * modulus.hi);
        found = lag_bounds(i, q);
        put(p, k, (bounds_t){down(found.lo - lag.hi), up(found.hi - lag.lo)});
    }
}
