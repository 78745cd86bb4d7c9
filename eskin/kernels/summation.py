"""Sums of many bounds, as tight as if they were rounded once."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from eskin.kernels.jit import kernel, part
from eskin.kernels.outward_rounding import add_up, next_up

if TYPE_CHECKING:
    from eskin.kernels.arithmetic import Floats


@part
def sum_up(row: Floats, sign: float) -> float:
    """At least ``sign`` times the sum of a row.

    Errors of the running sum are found exactly (TwoSum) and summed up apart, upwards: what that
    second sum loses is far below the result's own rounding (Ogita, Rump and Oishi 2005, Sum2).
    """
    total = error = 0.0
    for k in range(row.size):
        term = sign * row[k]
        grown = total + term
        part_of = grown - total
        lost = (total - (grown - part_of)) + (term - part_of)
        total = grown
        error = add_up(error, lost)
    if math.isfinite(total):
        return add_up(total, error)
    return slow_sum_up(row, sign)


@part
def slow_sum_up(row: Floats, sign: float) -> float:
    """The same where a sum overflows or a term is infinite."""
    total = 0.0
    for k in range(row.size):
        total = add_up(total, sign * row[k])
    return total if total > -math.inf else next_up(total)


@part
def running_sums_up(row: Floats, sign: float, out: Floats) -> None:
    """``sign`` times a value of at least ``sign`` times the sum, after each term of a row."""
    total = error = bound = 0.0
    for k in range(row.size):
        term = sign * row[k]
        grown = total + term
        part_of = grown - total
        lost = (total - (grown - part_of)) + (term - part_of)
        total = grown
        error = add_up(error, lost)
        bound = add_up(total, error) if math.isfinite(total) else add_up(bound, term)
        bound = bound if bound > -math.inf else next_up(bound)
        out[k] = sign * bound


@kernel
def running_sums(lo: Floats, hi: Floats, out_lo: Floats, out_hi: Floats) -> None:
    """The sums of each row up to each term; from an empty interval on they are empty."""
    for i in range(lo.shape[0]):
        n = 0
        while n < lo.shape[1] and lo[i, n] <= hi[i, n]:
            n += 1
        running_sums_up(lo[i, :n], -1.0, out_lo[i])
        running_sums_up(hi[i, :n], 1.0, out_hi[i])
        out_lo[i, n:] = math.inf
        out_hi[i, n:] = -math.inf


@kernel
def sums(lo: Floats, hi: Floats, out_lo: Floats, out_hi: Floats) -> None:
    """The sum of each row; of no numbers it is zero, with an empty interval it is empty."""
    for i in range(lo.shape[0]):
        empty = False
        for k in range(lo.shape[1]):
            empty |= lo[i, k] > hi[i, k]
        out_lo[i] = math.inf if empty else -sum_up(lo[i], -1.0)
        out_hi[i] = -math.inf if empty else sum_up(hi[i], 1.0)
