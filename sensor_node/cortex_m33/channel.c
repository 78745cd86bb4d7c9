/* Rest and smoothing: sensor_node/eskin_sensor_node/firmware/baseline.py and smoothing.py. */
#include "channel.h"

static bounds_t mean_bounds(const double *lows, const double *highs, int n)
{
    double lo = 0.0, hi = 0.0;
    for (int k = 0; k < n; k++)
        lo = down(lo + lows[k]), hi = up(hi + highs[k]);
    return (bounds_t){down(divide(lo, n)), up(divide(hi, n))};
}

int calibrate(baseline_t *rest, const double *lows, const double *highs, int n)
{
    bounds_t mean = mean_bounds(lows, highs, n);
    rest->known = less(mean.hi - mean.lo, INFINITY);
    if (rest->known)
        rest->lo = mean.lo, rest->hi = mean.hi;
    return rest->known;
}

int stays(baseline_t *rest, const double *lows, const double *highs, int n, double threshold)
{
    if (!rest->known)
        return 0;
    double least = rest->hi - threshold, most = rest->lo + threshold;
    for (int k = 0; k < n; k++)
        if (less(lows[k], least) || less(most, highs[k]))
            return 0;
    bounds_t mean = mean_bounds(lows, highs, n);
    rest->lo += 1.0 / 64 * (mean.lo - rest->lo);
    rest->hi += 1.0 / 64 * (mean.hi - rest->hi);
    return 1;
}

void smooth(smoothing_t *past, double *lows, double *highs, int n)
{
    double present = 1.0 - past->weight, below = down(present), above = up(present);
    for (int k = 0; k < n; k++) {
        double lo = lows[k], hi = highs[k];
        if (!less(-INFINITY, lo) || !less(hi, INFINITY)) {
            past->fresh = 1;
            continue;
        }
        if (!past->fresh) {
            lo = down(lo * (at_least_zero(lo) ? below : above));
            hi = up(hi * (at_least_zero(hi) ? above : below));
            lo = down(down(past->weight * past->lo) + lo);
            hi = up(up(past->weight * past->hi) + hi);
        }
        past->lo = lows[k] = lo, past->hi = highs[k] = hi, past->fresh = 0;
    }
}
