"""Intervals as text: what is printed encloses what is meant."""

from __future__ import annotations

import re
from decimal import MAX_EMAX, MIN_EMIN, ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import IntervalError

if TYPE_CHECKING:
    from eskin.interval.bounds import Bounds

_SPEC: Final = re.compile(r"(?:\.(?P<digits>\d{1,3}))?(?P<kind>[efg])?")
_DIGITS: Final = 6
_SHOWN: Final = 1000
_EDGE: Final = 3
_LONGEST: Final = 1400
"""More digits than a float has, or 999 places behind the point give."""


def text_of(x: Bounds, spec: str) -> str:
    """Intervals with bounds to so many digits, the lower rounded down, the upper rounded up.

    Args:
        x: The intervals; of many, only the first and last of each axis are written.
        spec: ``.4g``, ``.3f`` or ``.2e``, as for floats.

    Raises:
        IntervalError: The format is none of these.
    """
    match = _SPEC.fullmatch(spec)
    if match is None:
        raise IntervalError(f"format {spec!r} is none of .4g, .3f, .2e")
    digits = _DIGITS if match["digits"] is None else int(match["digits"])
    kind = match["kind"] or "g"
    return _nested(x, kind, digits, edge=_EDGE if x.size > _SHOWN else None)


def _nested(x: Bounds, kind: str, digits: int, edge: int | None) -> str:
    if x.ndim == 0:
        return _single(float(x.inf), float(x.sup), kind, digits)
    rows = [x[index] for index in _shown(len(x), edge)]
    texts = [_nested(row, kind, digits, edge) for row in rows]
    if len(texts) < len(x):
        texts.insert(_EDGE, "...")
    return "[" + ("\n " if x.ndim > 1 else " ").join(texts) + "]"


def _shown(length: int, edge: int | None) -> list[int]:
    if edge is None or length <= 2 * edge:
        return list(range(length))
    return [*range(edge), *range(length - edge, length)]


def _single(lo: float, hi: float, kind: str, digits: int) -> str:
    if lo > hi:
        return "[empty]"
    return f"[{_bound(lo, kind, digits, ROUND_FLOOR)}, {_bound(hi, kind, digits, ROUND_CEILING)}]"


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
