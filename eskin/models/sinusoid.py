"""Parts for what swings as a sine between two values (eq. 5, 7, 9, 10, 13 and 14).

A swing between ``a`` and ``b`` is written ``(1 - s)·a + s·b``: both weights are zero or more, so
each bound comes from one end of ``a`` and one of ``b``. Written as in the paper,
``a + (b - a)·s``, the same interval ``a`` would count twice.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import inlined, part
from eskin.kernels.sine import (
    sincospi_of_product,
    sincospi_of_two,
    unit_down,
    unit_up,
)
from eskin.models.bounds import U, above, below

if TYPE_CHECKING:
    from eskin.models.parameters import Floats

SMALL: Final = 2.0**-148
"""What the weights of a swing may be off besides, from summing the angle."""


@part
def sine_of_time(work: Floats, frequency: int, time: int, into: int, n: int) -> None:
    """Bounds of ``sin(2π f t)`` over one block.

    Args:
        work: The block; see `eskin.models.broadcasting.load`.
        frequency: Row of the lower bounds of f >= 0, the upper ones follow.
        time: Row of the lower bounds of t, the upper ones follow.
        into: Row for the lower bounds of the sine, the upper ones follow.
        n: Length of the block.
    """
    thin = True
    for i in range(n):
        thin &= (work[frequency, i] == work[frequency + 1, i]) & (
            work[time, i] == work[time + 1, i]
        )
    if thin:
        for i in range(n):
            sine, _ = sincospi_of_product(2.0 * work[frequency, i], work[time, i])
            work[into, i] = unit_down(sine)
            work[into + 1, i] = unit_up(sine)
    else:
        for i in range(n):
            work[into, i], work[into + 1, i] = _sine_of_intervals(
                work[frequency, i], work[frequency + 1, i], work[time, i], work[time + 1, i]
            )


@part
def _sine_of_intervals(
    f_inf: float, f_sup: float, t_inf: float, t_sup: float
) -> tuple[float, float]:
    f_first = f_inf if t_inf >= 0.0 else f_sup
    f_last = f_sup if t_sup >= 0.0 else f_inf
    first, _ = sincospi_of_product(2.0 * f_first, t_inf)
    last, _ = sincospi_of_product(2.0 * f_last, t_sup)
    bottom, top = _extremes(f_first, t_inf, f_last, t_sup)
    lower = -1.0 if bottom else unit_down(min(first, last))
    upper = 1.0 if top else unit_up(max(first, last))
    return lower, upper


@part
def _extremes(f_first: float, t_inf: float, f_last: float, t_sup: float) -> tuple[bool, bool]:
    """Whether the sine reaches its least and its greatest value in between.

    Outward by more than the roundings: one just outside then counts, which costs nothing. A single
    angle reaches none in between, however far it is.
    """
    if (f_first == f_last) & (t_inf == t_sup):
        return False, False
    start, end = 2.0 * f_first * t_inf, 2.0 * f_last * t_sup
    start -= abs(start) * 8.0 * U
    end += abs(end) * 8.0 * U
    return _reaches(start, end, -0.5), _reaches(start, end, 0.5)


@part
def _is_thin(work: Floats, frequency: int, time: int, n: int) -> bool:
    thin = True
    for i in range(n):
        thin &= (work[frequency, i] == work[frequency + 1, i]) & (
            work[time, i] == work[time + 1, i]
        )
    return thin


@part
def _reaches(start: float, end: float, peak: float) -> bool:
    """Whether ``peak`` plus an even number lies between.

    In floats: an angle may count more half turns than an integer of 64 bits holds.
    """
    first: float = np.ceil(0.5 * (start - peak))
    last: float = np.floor(0.5 * (end - peak))
    return last >= first


@inlined
def weights_at(frequency: float, time: float) -> tuple[float, float]:
    """``0.5 + 0.5·sin(2π f t)`` and what it leaves to 1: sin² and cos² of ``π·(f t + 1/4)``.

    Squares keep small weights exact to the last bits, where ``0.5 + 0.5·sin`` cancels. The angle
    is summed to within 2⁻¹⁰⁵ half turns. So each is right within 6 U, and `SMALL` besides.
    """
    high = frequency * time
    low = fma(frequency, time, -high)
    a = fma(-2.0, np.rint(0.5 * high), high)
    b = fma(-2.0, np.rint(0.5 * low), low)
    c = a + 0.25
    c_part = c - a
    c_rest = (a - (c - c_part)) + (0.25 - c_part)
    d = c + b
    d_part = d - c
    d_rest = (c - (d - d_part)) + (b - d_part)
    sine, cosine = sincospi_of_two(d, d_rest + c_rest)
    return sine * sine, cosine * cosine


@part
def raise_sine(work: Floats, frequency: int, time: int, into: int, n: int) -> None:
    """Weights of the raised sine over one block, where it is least and where it is greatest.

    Args:
        work: The block; see `eskin.models.broadcasting.load`.
        frequency: Row of the lower bounds of f >= 0, the upper ones follow.
        time: Row of the lower bounds of t, the upper ones follow.
        into: Row for the least ``0.5 + 0.5·sin(2π f t)``; what it leaves to 1, and both of the
            greatest, follow.
        n: Length of the block.
    """
    if _is_thin(work, frequency, time, n):
        _raise_thin(work, frequency, time, into, n)
    else:
        _raise_thick(work, frequency, time, into, n)


@part
def _raise_thin(work: Floats, frequency: int, time: int, into: int, n: int) -> None:
    for i in range(n):
        work[into, i], work[into + 1, i] = weights_at(work[frequency, i], work[time, i])
    for i in range(n):  # apart, as the compiler gives up on loops over too many rows
        work[into + 2, i] = work[into, i]
    for i in range(n):
        work[into + 3, i] = work[into + 1, i]


@part
def _raise_thick(work: Floats, frequency: int, time: int, into: int, n: int) -> None:
    for i in range(n):
        f_inf, f_sup = work[frequency, i], work[frequency + 1, i]
        t_inf, t_sup = work[time, i], work[time + 1, i]
        f_first, f_last = f_inf if t_inf >= 0.0 else f_sup, f_sup if t_sup >= 0.0 else f_inf
        s, rest = weights_at(f_first, t_inf)
        s_last, rest_last = weights_at(f_last, t_sup)
        bottom, top = _extremes(f_first, t_inf, f_last, t_sup)
        rises = s <= s_last
        work[into, i] = 0.0 if bottom else (s if rises else s_last)
        work[into + 1, i] = 1.0 if bottom else (rest if rises else rest_last)
        work[into + 2, i] = 1.0 if top else (s_last if rises else s)
        work[into + 3, i] = 0.0 if top else (rest_last if rises else rest)


@part
def mixed_down(work: Floats, at: int, i: int, a: float, b: float) -> float:
    """Lower bound of ``(1 - s)·a + s·b`` from the lower bounds of ``a`` and ``b``, both > 0.

    It is linear in s, so the least or the greatest s, of row ``at`` and after, gives it.
    """
    first = _mixed(work[at, i] - SMALL, work[at + 1, i] - SMALL, a, b)
    last = _mixed(work[at + 2, i] - SMALL, work[at + 3, i] - SMALL, a, b)
    return below(min(first, last), 9)


@part
def mixed_up(work: Floats, at: int, i: int, a: float, b: float) -> float:
    """Upper bound of ``(1 - s)·a + s·b`` from the upper bounds of ``a`` and ``b``, both > 0."""
    first = _mixed(work[at, i] + SMALL, work[at + 1, i] + SMALL, a, b)
    last = _mixed(work[at + 2, i] + SMALL, work[at + 3, i] + SMALL, a, b)
    return above(max(first, last), 9)


@part
def _mixed(s: float, rest: float, a: float, b: float) -> float:
    return max(rest, 0.0) * a + max(s, 0.0) * b
