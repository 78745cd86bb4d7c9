"""Bounds out of rounded values: outward by as much as the roundings in them can amount to.

A value ``x >= 0`` out of ``n`` rounded multiplications, divisions, square roots and sums of such
values lies between ``truth·(1 - u)ⁿ`` and ``truth·(1 + u)ⁿ``, ``u = 2⁻⁵³``, as long as nothing
leaves the range of normal floats: `eskin.models.parameters` sees to that. So one multiplication
at the end encloses the truth, which costs a tenth of rounding each step on its side.
"""

from __future__ import annotations

from typing import Final

from eskin.kernels.jit import part
from eskin.kernels.outward_rounding import mul_down

U: Final = 2.0**-53
"""Greatest relative error of one rounding."""
TINY: Final = 1e-320
"""More than a few roundings amount to among the least floats."""
TWO_PI: Final = 6.283185307179586
"""2π within `U`: counts as one rounding."""


@part
def below(x: float, roundings: int) -> float:
    """At most the truth behind ``x >= 0``.

    ``truth >= x·(1 - n·u)``, and ``(1 - (n + 1)·u)·(1 + u) < 1 - n·u`` pays for this product.
    """
    return x * (1.0 - (roundings + 1) * U)


@part
def above(x: float, roundings: int) -> float:
    """At least the truth behind ``x >= 0``.

    ``truth <= x·(1 + n·u + n²·u²)``, and ``(1 + (n + 2)·u)·(1 - u)`` is more.
    """
    return x * (1.0 + 2.0 * U * ((roundings + 3) // 2))


@part
def product_down(a_inf: float, a_sup: float, b_inf: float, b_sup: float) -> float:
    """Lower bound of the product of two finite intervals."""
    return min(
        mul_down(a_inf, b_inf),
        mul_down(a_inf, b_sup),
        mul_down(a_sup, b_inf),
        mul_down(a_sup, b_sup),
    )


@part
def product_up(a_inf: float, a_sup: float, b_inf: float, b_sup: float) -> float:
    """Upper bound of the product of two finite intervals."""
    return -product_down(-a_sup, -a_inf, b_inf, b_sup)
