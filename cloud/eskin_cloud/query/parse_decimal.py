"""Enclose decimal numbers of queries by floats."""

from __future__ import annotations

import math
from decimal import MAX_EMAX, MIN_EMIN, ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from typing import Final

_DIGITS: Final = 200
"""More digits than any parameter has."""


def enclose_decimal(text: str) -> tuple[float, float]:
    """The greatest float not above a decimal number, and the least not below.

    Args:
        text: Such as ``0.1``, ``1e-3`` or ``inf``.

    Raises:
        ValueError: The text is no number.
    """
    near = float(text)
    lo, hi = (_read(text.strip(), rounding) for rounding in (ROUND_FLOOR, ROUND_CEILING))
    if lo.is_nan():
        raise ValueError(f"{text!r} is no number")
    exact = Decimal(near)
    return (
        near if exact <= lo else math.nextafter(near, -math.inf),
        near if exact >= hi else math.nextafter(near, math.inf),
    )


def _read(text: str, rounding: str) -> Decimal:
    """Parse exactly, except for exponents beyond those of floats."""
    limits = Context(_DIGITS, rounding, MIN_EMIN, MAX_EMAX, capitals=1, clamp=0, flags=[], traps=[])
    return limits.create_decimal(text)
