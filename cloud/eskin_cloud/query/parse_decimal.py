"""Numbers of questions, from their text: enclosed, as few of them are floats."""

from __future__ import annotations

import math
from decimal import MAX_EMAX, MIN_EMIN, ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from typing import Final

_DIGITS: Final = 200
"""More than any text that is asked has."""


def enclose_decimal(text: str) -> tuple[float, float]:
    """The greatest float not above a decimal number, and the least not below.

    Args:
        text: Such as ``0.1``, ``1e-3`` or ``inf``.

    Raises:
        ValueError: It is no number.
    """
    near = float(text)
    lo, hi = (_read(text.strip(), rounding) for rounding in (ROUND_FLOOR, ROUND_CEILING))
    if lo.is_nan():
        raise ValueError(f"{text!r} is no number")
    told = Decimal(near)
    return (
        near if told <= lo else math.nextafter(near, -math.inf),
        near if told >= hi else math.nextafter(near, math.inf),
    )


def _read(text: str, rounding: str) -> Decimal:
    """Exactly, but for exponents that no float has."""
    limits = Context(_DIGITS, rounding, MIN_EMIN, MAX_EMAX, capitals=1, clamp=0, flags=[], traps=[])
    return limits.create_decimal(text)
