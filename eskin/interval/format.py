"""Intervals as text: what is printed encloses what is meant."""

from __future__ import annotations

import re
from decimal import MAX_EMAX, MIN_EMIN, ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.errors import IntervalError

if TYPE_CHECKING:
    from collections.abc import Callable

    from eskin.interval.bounds import Bounds

_SPEC: Final = re.compile(r"(?:\.(?P<digits>\d{1,3}))?(?P<kind>[efg])?")
_DIGITS: Final = 6
_OF_WIDTH: Final = 2
"""Digits of the width that are shown, so that a thin interval looks thin."""
_OF_FLOAT: Final = (15, 16, 17)
"""Digits that distinguish a float from its neighbours, the fewest first."""
_LONGEST: Final = 1400
"""More digits than a float has, or 999 places behind the point give."""


def text_of(x: Bounds, spec: str) -> str:
    """Intervals in decimals, the lower bound rounded down, the upper one up.

    Args:
        x: The intervals; of many, numpy's print options say which are shown and where lines end.
        spec: ``.4g``, ``.3f`` or ``.2e``, as for floats. If empty, bounds have six digits, or as
            many as show two digits of the width; a single number has as many as distinguish it from
            others.

    Raises:
        IntervalError: The format is none of these.
    """
    match = _SPEC.fullmatch(spec)
    if match is None:
        raise IntervalError(f"format {spec!r} is none of .4g, .3f, .2e")
    if not spec:
        return _all(x, _by_width)
    digits = _DIGITS if match["digits"] is None else int(match["digits"])
    kind = match["kind"] or "g"
    return _all(
        x,
        lambda lo, hi: (
            _bound(lo, kind, digits, ROUND_FLOOR),
            _bound(hi, kind, digits, ROUND_CEILING),
        ),
    )


def format_up(value: float) -> str:
    """A number to three digits, rounded up."""
    return "" if np.isnan(value) else _bound(value, "g", 3, ROUND_CEILING)


def _all(x: Bounds, write: Callable[[float, float], tuple[str, str]]) -> str:
    """All intervals as numpy lays out an array: summarised, wrapped, and below each other."""
    lo, hi = x.inf.reshape(-1), x.sup.reshape(-1)

    def text(k: int) -> str:
        if lo[k] > hi[k]:
            return "[empty]"
        return f"[{', '.join(write(float(lo[k]), float(hi[k])))}]"

    if x.ndim == 0:
        return text(0)
    numbers, texts = np.arange(x.size).reshape(x.shape), {}

    def note(k: Any) -> str:
        texts[k] = text(k)
        return "."

    def write_out(k: Any) -> str:
        return texts[k].rjust(wide)

    np.array2string(numbers, formatter={"int": note})
    wide = max(map(len, texts.values()), default=0)
    return np.array2string(numbers, formatter={"int": write_out})


def _by_width(lo: float, hi: float) -> tuple[str, str]:
    """Bounds whose difference one sees."""
    if lo == hi:
        return _single(lo, ROUND_FLOOR), _single(hi, ROUND_CEILING)
    digits = [_DIGITS, _DIGITS]
    if np.isfinite(lo) and np.isfinite(hi):
        width = _context(_OF_WIDTH, ROUND_FLOOR).subtract(Decimal(hi), Decimal(lo)).adjusted()
        sizes = [Decimal(value).adjusted() if value else width for value in (lo, hi)]
        wanted = [size - width + _OF_WIDTH for size in sizes]
        digits = [min(max(_DIGITS, each), _OF_FLOAT[-1]) for each in wanted]
    return _bound(lo, "g", digits[0], ROUND_FLOOR), _bound(hi, "g", digits[1], ROUND_CEILING)


def _single(value: float, rounding: str) -> str:
    """A bound in the fewest digits that are read back as the same float, if 17 do."""
    texts = (_bound(value, "g", digits, rounding) for digits in _OF_FLOAT)
    return next((text for text in texts if float(text) == value), "") or _bound(
        value, "g", _OF_FLOAT[-1], rounding
    )


def _bound(value: float, kind: str, digits: int, rounding: str) -> str:
    if not np.isfinite(value):
        return "-inf" if value < 0 else "inf"
    if kind == "f":
        own, step = _context(_LONGEST, rounding), Decimal((0, (1,), -digits))
        return format(own.quantize(own.create_decimal_from_float(value), step), f".{digits}f")
    count = max(digits, 1) if kind == "g" else digits + 1
    own = _context(count, rounding)
    rounded = own.create_decimal_from_float(value)
    if kind == "e":
        return format(rounded, f".{digits}e")
    plain = rounded == 0 or -5 < rounded.adjusted() < max(count, 1)
    return format(own.normalize(rounded), "f" if plain else "e")


def _context(digits: int, rounding: str) -> Context:
    """Nothing of the caller's context, which would round once more, and to the nearest."""
    return Context(digits, rounding, MIN_EMIN, MAX_EMAX, capitals=1, clamp=0, flags=[], traps=[])
