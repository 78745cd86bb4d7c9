"""Directed rounding without the processor's help: one float further out, always.

IEEE 754 rounds a result to a neighbour of the exact one, so the exact one lies between the
neighbours of the result. Source: Rump, Zimmermann, Boldo, Melquiond, "Computing predecessor and
successor in rounding to nearest", BIT 49 (2009), algorithm 1.
"""

_TWO_53 = 9007199254740992
# u·(1 + 2u), u = 2^-53. Divisions of small integers: no port need parse a decimal exactly.
_PHI = (1.0 / _TWO_53) * (1.0 + 2.0 / _TWO_53)


def _least() -> float:
    least = 1.0
    while least * 0.5 > 0.0:
        least *= 0.5
    return least


def _most() -> float:
    most = 1.0
    while most * 2.0 - most == most:
        most *= 2.0
    return most * (2.0 - 2.0 / _TWO_53)


LEAST = _least()
"""The least positive float, 2^-1074."""
MOST = _most()
"""The greatest finite float."""
INFINITY = MOST * 2.0
TWO_PI_LO = 7074237752028440 / 1125899906842624
TWO_PI_HI = 7074237752028441 / 1125899906842624
"""Neighbours of 2π."""


def down(x: float) -> float:
    """A float below the exact result that was rounded to ``x``; ``-inf`` stays."""
    below = x - (_PHI * abs(x) + LEAST)
    if below == below:  # noqa: PLR0124 - infinity less infinity is not a number
        return below
    return x if x < 0.0 else MOST


def up(x: float) -> float:
    """A float above the exact result that was rounded to ``x``; ``inf`` stays."""
    above = x + (_PHI * abs(x) + LEAST)
    if above == above:  # noqa: PLR0124
        return above
    return x if x > 0.0 else -MOST
