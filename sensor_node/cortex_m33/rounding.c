/* Directed rounding without the processor's help: Rump and others, BIT 49 (2009), algorithm 1. */
#include "rounding.h"

double down_by_formula(double x)
{
    double below = x - (PHI * fabs(x) + LEAST);
    if (below == below)
        return below;
    return x < 0.0 ? x : MOST;
}

double up_by_formula(double x)
{
    double above = x + (PHI * fabs(x) + LEAST);
    if (above == above)
        return above;
    return x > 0.0 ? x : -MOST;
}
