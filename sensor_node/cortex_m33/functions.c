/* Enclosures of the logarithm and the arc tangent: sensor_node/eskin_sensor_node/firmware/logarithm.py, arctangent.py. */
#include "inversion.h"

static const double LN2 = 0x1.62e42fefa39efp-1;
static const double INVERSE[] = {1.0 / 21, 1.0 / 19, 1.0 / 17, 1.0 / 15, 1.0 / 13, 1.0 / 11,
                                 1.0 / 9,  1.0 / 7,  1.0 / 5,  1.0 / 3,  1.0};
enum { TERMS = sizeof INVERSE / sizeof *INVERSE };

bounds_t logarithm(double x)
{
    if (!less(0.0, x))
        return (bounds_t){-INFINITY, -INFINITY};
    if (less(MOST, x))
        return (bounds_t){INFINITY, INFINITY};
    int k = 0;
    while (less(x, 0.75)) {
        x *= 2.0;
        k -= 1;
    }
    while (less(1.5, x)) {
        x *= 0.5;
        k += 1;
    }
    double z = divide(x - 1.0, x + 1.0), square = z * z, total = 1.0 / 23;
    for (int j = 0; j < TERMS; j++)
        total = total * square + INVERSE[j];
    double part = 2.0 * z * total, whole = k * LN2;
    double slack = SLACK * (fabs(part) + fabs(whole));
    return (bounds_t){down(part + whole - slack), up(part + whole + slack)};
}

bounds_t arctangent(double x)
{
    double size = fabs(x), whole = less(1.0, size) ? 0.25 * TWO_PI_LO : 0.0;
    double z = less(1.0, size) ? divide(1.0, size) : size;
    z = divide(z, 1.0 + sqrt(1.0 + z * z));
    z = divide(z, 1.0 + sqrt(1.0 + z * z));
    double square = z * z, total = 1.0 / 23;
    for (int j = 0; j < TERMS; j++)
        total = INVERSE[j] - total * square;
    double part = 4.0 * z * total, slack = SLACK * (part + whole) + 4.0 * LEAST;
    double value = fabs(whole - part);
    double lo = down(value - slack), hi = up(value + slack);
    return at_least_zero(x) ? (bounds_t){lo, hi} : (bounds_t){-hi, -lo};
}
