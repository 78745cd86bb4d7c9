"""Sine and cosine of angles in half turns: exact reduction, polynomials of our own, proven bounds.

Half turns make the reduction exact for every float: ``x - 2·rint(x/2)`` is an IEEE remainder, and
taking the nearest quarter turn off leaves ``|r| <= 1/4`` without rounding. On what is left, Taylor
polynomials of degree 17 and 16 stand in for sine and cosine.

Error, with ``u = 2**-53``, relative to the true value, for ``|r| <= 1/4``:

* Sine, ``fma(r, PI, r·(PI_LOW + r²·Q))``: the last rounding gives ``u``. The correction is at most
  0.111 of the result, and carries roundings of its leading coefficient, of ``r²``, of two fused
  steps and of one product: ``0.111 · 5u``. The truncated term is ``(π/4)**19/19!``, below 0.001 u.
  Together below 1.6 u.
* Cosine, ``fma(r², W, 1)`` with ``W`` about ``-π²/2``: in absolute terms ``0.5 u`` for the last
  rounding, 0.25 u from rounding ``W``, 0.18 u from the float nearest ``π²/2``, 0.16 u from ``r²``,
  0.06 u from the rest of ``W``, 0.01 u truncated; the result is at least 0.707. Together below
  1.65 u.
* A second word ``e`` of the angle, ``|e| <= u·|r|``, enters ``r²`` before its rounding, and the
  correction of the sine by one more fused step, ``0.111 u``; what is left out is below ``4 u²``.

So all are within `RELATIVE_ERROR` = 1.7 u, also beside a zero; below 2**-1000 (where products lose
bits to gradual underflow) within `ABSOLUTE_ERROR` besides. Multiples of a quarter turn are exact.
NaN and infinities give NaN.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from eskin.kernels.intrinsics import fma
from eskin.kernels.jit import part

RELATIVE_ERROR: Final = 0.85 * 2.0**-52
"""Proven relative error of every sine and cosine here."""
ABSOLUTE_ERROR: Final = 8 * 5e-324
"""Proven absolute error besides, from gradual underflow."""
_WIDENING: Final = 1.36 * 2.0**-52  # the error, and u more because the sum is rounded
_LEAST: Final = 5e-324
_PI: Final = 3.141592653589793
_PI_LOW: Final = 1.2246467991473532e-16
# Taylor: (-1)^k π^(2k+1)/(2k+1)! from k = 1, and (-1)^k π^(2k)/(2k)! from k = 1.
_S1: Final = -5.16771278004997
_S2: Final = 2.5501640398773455
_S3: Final = -0.5992645293207921
_S4: Final = 0.08214588661112823
_S5: Final = -0.0073704309457143504
_S6: Final = 0.00046630280576761255
_S7: Final = -2.1915353447830217e-05
_S8: Final = 7.952054001475513e-07
_C1: Final = -4.934802200544679
_C2: Final = 4.0587121264167685
_C3: Final = -1.3352627688545895
_C4: Final = 0.2353306303588932
_C5: Final = -0.02580689139001406
_C6: Final = 0.0019295743094039231
_C7: Final = -0.0001046381049248457
_C8: Final = 4.303069587032947e-06


@part
def _sine_tail(t: float) -> float:
    """``(sin(πr) - πr)/r³`` for ``t = r² <= 1/16``."""
    tail = fma(t, _S8, _S7)
    tail = fma(t, tail, _S6)
    tail = fma(t, tail, _S5)
    tail = fma(t, tail, _S4)
    tail = fma(t, tail, _S3)
    tail = fma(t, tail, _S2)
    return fma(t, tail, _S1)


@part
def _cosine_tail(t: float) -> float:
    """``(cos(πr) - 1)/r²`` for ``t = r² <= 1/16``."""
    tail = fma(t, _C8, _C7)
    tail = fma(t, tail, _C6)
    tail = fma(t, tail, _C5)
    tail = fma(t, tail, _C4)
    tail = fma(t, tail, _C3)
    tail = fma(t, tail, _C2)
    return fma(t, tail, _C1)


@part
def _core(r: float) -> tuple[float, float]:
    """Sine and cosine of ``r`` half turns, ``|r| <= 1/4``."""
    t = r * r
    sine = fma(r, _PI, r * fma(t, _sine_tail(t), _PI_LOW))
    return sine, fma(t, _cosine_tail(t), 1.0)


@part
def _core_of_two(r: float, e: float) -> tuple[float, float]:
    """Sine and cosine of ``r + e`` half turns, ``|r| <= 1/4``, ``|e| <= 2**-53·|r|``."""
    t = fma(r, r, 2.0 * r * e)
    tail = t * _sine_tail(t)
    sine = fma(r, _PI, fma(e, _PI + tail, r * (_PI_LOW + tail)))
    return sine, fma(t, _cosine_tail(t), 1.0)


@part
def _turned(sine: float, cosine: float, quarters: float) -> tuple[float, float]:
    """Turn an angle on by ``quarters`` in -2, -1, 0, 1, 2."""
    odd = abs(quarters) == 1.0
    half = abs(quarters) == 2.0
    turned_sine = cosine if odd else sine
    turned_cosine = sine if odd else cosine
    return (
        -turned_sine if (half | (quarters == -1.0)) else turned_sine,
        -turned_cosine if (half | (quarters == 1.0)) else turned_cosine,
    )


@part
def sincospi(x: float) -> tuple[float, float]:
    """Sine and cosine of ``x`` half turns."""
    near = fma(-2.0, np.rint(0.5 * x), x)
    quarters = np.rint(2.0 * near)
    sine, cosine = _core(fma(-0.5, quarters, near))
    return _turned(sine, cosine, quarters)


@part
def sincospi_of_two(high: float, low: float) -> tuple[float, float]:
    """Sine and cosine of ``high + low`` half turns, an angle of two floats."""
    a = fma(-2.0, np.rint(0.5 * high), high)
    b = fma(-2.0, np.rint(0.5 * low), low)
    total = a + b
    b_part = total - a
    rest = (a - (total - b_part)) + (b - b_part)
    quarters = np.rint(2.0 * total)
    near = fma(-0.5, quarters, total)
    # What is left may have cancelled below its rest: order the two again.
    r = near + rest
    rest_part = r - near
    e = (near - (r - rest_part)) + (rest - rest_part)
    sine, cosine = _core_of_two(r, e)
    return _turned(sine, cosine, fma(-4.0, np.rint(0.25 * quarters), quarters))


@part
def sincospi_of_product(a: float, b: float) -> tuple[float, float]:
    """Sine and cosine of ``a·b`` half turns, with the product unrounded.

    With ``a = 2f`` it is ``sin(2π f t)``, right for every time; the rounded product would cost
    hundreds of ulp.
    """
    product = a * b
    sine, cosine = sincospi_of_two(product, fma(a, b, -product))
    vanished = (product == 0.0) & (a != 0.0) & (b != 0.0)
    least = -_LEAST if (a < 0.0) != (b < 0.0) else _LEAST
    return least if vanished else sine, cosine


@part
def unit_up(value: float) -> float:
    """Upper bound of a sine or cosine that came out as ``value``; zero is exact."""
    bound = min(fma(abs(value), _WIDENING, value) + ABSOLUTE_ERROR, 1.0)
    return value if value == 0.0 else bound


@part
def unit_down(value: float) -> float:
    """Lower bound of a sine or cosine that came out as ``value``."""
    return -unit_up(-value)
