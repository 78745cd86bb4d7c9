/* What presses a pad: sensor_node/eskin_sensor_node/firmware/inversion/pad.py. */
#include "inversion.h"

static bounds_t plate_distance_bounds(bounds_t c, bounds_t k, bounds_t plates)
{
    bounds_t found = {-INFINITY, INFINITY};
    if (less(c.hi, INFINITY) && less(0.0, k.lo))
        found.lo = down(divide(down(plates.lo * k.lo), c.hi));
    if (less(0.0, c.lo) && less(k.hi, INFINITY))
        found.hi = up(divide(up(plates.hi * k.hi), c.lo));
    return found;
}

static bounds_t felt_bounds(bounds_t d, bounds_t rest, bounds_t elasticity)
{
    bounds_t found = {-INFINITY, INFINITY};
    if (less(d.hi, INFINITY)) {
        double ratio = down(down(divide(rest.lo, d.hi)) - 1.0);
        found.lo = down(ratio * (at_least_zero(ratio) ? elasticity.lo : elasticity.hi));
    }
    if (less(0.0, d.lo)) {
        double ratio = up(up(divide(rest.hi, d.lo)) - 1.0);
        found.hi = up(ratio * (at_least_zero(ratio) ? elasticity.hi : elasticity.lo));
    }
    return found;
}

void measure_felt(const input_t *in, bounds_t factor, const pad_t *pad, buffer_t c, buffer_t i,
                  buffer_t d, buffer_t p)
{
    for (int k = 0; k < in->n; k++) {
        bounds_t x = code_bounds(in->codes[k], in->last, &in->adc, in->reach);
        i.lo[k] = x.lo, i.hi[k] = x.hi;
        x = capacitance_bounds(x, factor);
        c.lo[k] = x.lo, c.hi[k] = x.hi;
        x = plate_distance_bounds(x, (bounds_t){d.lo[k], d.hi[k]}, pad->plates);
        d.lo[k] = x.lo, d.hi[k] = x.hi;
        x = felt_bounds(x, pad->rest, pad->elasticity);
        p.lo[k] = x.lo, p.hi[k] = x.hi;
    }
}

void measure_unknown(int n, double most, int missing, double *total, double *least)
{
    for (int k = 0; k < n; k++)
        total[k] = up(missing * most), least[k] = most;
}

void measure_neighbour(int n, double most, const double *felt_lo, const double *felt_hi,
                       double *total, double *least)
{
    for (int k = 0; k < n; k++) {
        double above = felt_hi[k];
        if (!less(-INFINITY, felt_lo[k]) || less(most, above) || less(above, 0.0))
            above = most;
        total[k] = up(total[k] + above);
        least[k] = least_of(least[k], above);
    }
}

void measure_pressure(int n, bounds_t area, double most, const crosstalk_t *crosstalk, buffer_t a,
                      buffer_t p)
{
    for (int k = 0; k < n; k++) {
        double doubt = up(crosstalk->doubtful * up(most - a.lo[k]));
        double handed = up(crosstalk->share * up(a.hi[k] + doubt));
        double lo = down(p.lo[k] - least_of(handed, crosstalk->most_handed)), hi = p.hi[k];
        if (less(hi, 0.0) || less(most, lo)) {
            p.lo[k] = a.lo[k] = -INFINITY;
            p.hi[k] = a.hi[k] = INFINITY;
            continue;
        }
        int open_below = !less(-INFINITY, lo);
        lo = most_of(lo, 0.0);
        p.lo[k] = open_below ? -INFINITY : lo;
        a.lo[k] = open_below ? -INFINITY : most_of(down(down(divide(lo, most)) * area.lo), 0.0);
        a.hi[k] = area.hi;
    }
}
