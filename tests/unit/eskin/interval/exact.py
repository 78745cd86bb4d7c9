"""The exact result of a function of floats, at any precision (mpmath)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import mpmath
import numpy as np
from hypothesis import strategies as st

from eskin.interval import Interval

if TYPE_CHECKING:
    from collections.abc import Callable

Exact: TypeAlias = Any
"""An `mpmath.mpf`; mpmath ships no types."""
FLOATS = st.floats(allow_nan=False, allow_infinity=False)
EXTREME = st.one_of(
    FLOATS,
    st.floats(-10.0, 10.0),
    st.integers(-20, 20).map(float),
    st.sampled_from([0.0, 5e-324, -5e-324, 2.2e-308, 1.7e308, -1.7e308, 1.0, -1.0, 2.0**53]),
)


def _whole_if_near(x: Exact) -> Exact:
    """A logarithm without the rounding of a quotient, which is far from whole where it is not."""
    return mpmath.nint(x) if abs(x - mpmath.nint(x)) < mpmath.mpf(2) ** -200 else x


UNARY: dict[str, tuple[Callable[[Interval], Interval], Callable[[Exact], Exact]]] = {
    "neg": (Interval.__neg__, lambda x: -x),
    "abs": (Interval.__abs__, abs),
    "recip": (Interval.recip, lambda x: 1 / x),
    "sqr": (Interval.sqr, lambda x: x * x),
    "cube": (lambda x: x.pown(3), lambda x: x**3),
    "pown7": (lambda x: x.pown(7), lambda x: x**7),
    "pown-2": (lambda x: x.pown(-2), lambda x: x**-2),
    "pown-3": (lambda x: x.pown(-3), lambda x: x**-3),
    "sqrt": (Interval.sqrt, mpmath.sqrt),
    "exp": (Interval.exp, mpmath.exp),
    "log": (Interval.log, mpmath.log),
    "sin": (Interval.sin, mpmath.sin),
    "cos": (Interval.cos, mpmath.cos),
    "tan": (Interval.tan, mpmath.tan),
    "atan": (Interval.atan, mpmath.atan),
    "asin": (Interval.asin, mpmath.asin),
    "acos": (Interval.acos, mpmath.acos),
    "sinh": (Interval.sinh, mpmath.sinh),
    "cosh": (Interval.cosh, mpmath.cosh),
    "tanh": (Interval.tanh, mpmath.tanh),
    "asinh": (Interval.asinh, mpmath.asinh),
    "acosh": (Interval.acosh, mpmath.acosh),
    "atanh": (Interval.atanh, mpmath.atanh),
    "exp2": (Interval.exp2, lambda x: mpmath.mpf(2) ** x),
    "exp10": (Interval.exp10, lambda x: mpmath.mpf(10) ** x),
    "expm1": (Interval.expm1, mpmath.expm1),
    "log2": (Interval.log2, lambda x: _whole_if_near(mpmath.log(x) / mpmath.log(2))),
    "log10": (Interval.log10, lambda x: _whole_if_near(mpmath.log(x) / mpmath.log(10))),
    "log1p": (Interval.log1p, mpmath.log1p),
    "cbrt": (Interval.cbrt, lambda x: mpmath.sign(x) * mpmath.cbrt(abs(x))),
    "rootn4": (lambda x: x.rootn(4), lambda x: mpmath.root(x, 4)),
    "rootn-5": (lambda x: x.rootn(-5), lambda x: 1 / mpmath.sign(x) / mpmath.root(abs(x), 5)),
    "sign": (Interval.sign, mpmath.sign),
    "ceil": (Interval.ceil, mpmath.ceil),
    "floor": (Interval.floor, mpmath.floor),
    "trunc": (Interval.trunc, lambda x: mpmath.sign(x) * mpmath.floor(abs(x))),
    "round_ties_to_even": (Interval.round_ties_to_even, mpmath.nint),
    "round_ties_to_away": (
        Interval.round_ties_to_away,
        lambda x: mpmath.sign(x) * mpmath.floor(abs(x) + mpmath.mpf(0.5)),
    ),
}
BINARY: dict[str, tuple[Callable[[Interval, Interval], Interval], Callable[[Exact, Exact], Exact]]]
BINARY = {
    "add": (lambda a, b: a + b, lambda x, y: x + y),
    "sub": (lambda a, b: a - b, lambda x, y: x - y),
    "mul": (lambda a, b: a * b, lambda x, y: x * y),
    "div": (lambda a, b: a / b, lambda x, y: x / y),
    "pow": (lambda a, b: a**b, lambda x, y: x**y),
    "atan2": (lambda a, b: a.atan2(b), mpmath.atan2),
    "min": (lambda a, b: a.min(b), min),
    "max": (lambda a, b: a.max(b), max),
    "hypot": (lambda a, b: a.hypot(b), mpmath.hypot),
}


_LEAST, _MOST = 5e-324, float(np.finfo(float).max)
_DOMAINS = {
    "sqrt": (0.0, _MOST),
    "rootn4": (0.0, _MOST),
    "log": (_LEAST, _MOST),
    "log2": (_LEAST, _MOST),
    "log10": (_LEAST, _MOST),
    "log1p": (float(np.nextafter(-1.0, 0.0)), _MOST),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
    "acosh": (1.0, _MOST),
    "atanh": (float(np.nextafter(-1.0, 0.0)), float(np.nextafter(1.0, 0.0))),
}


def is_defined(name: str, *x: float) -> bool:
    """Whether a function of `UNARY` or `BINARY` is defined there."""
    if name in {"recip", "pown-2", "pown-3", "rootn-5"}:
        return x[0] != 0.0
    if name in _DOMAINS:
        least, most = _DOMAINS[name]
        return least <= x[0] <= most
    if name == "div":
        return x[1] != 0.0
    if name == "pow":
        return x[0] > 0.0 or (x[0] == 0.0 and x[1] > 0.0)
    return name != "atan2" or x != (0.0, 0.0)


def is_affordable(name: str, *x: float) -> bool:
    """Whether mpmath calculates it in sensible time and memory."""
    if name in {"exp", "exp2", "exp10", "expm1", "sinh", "cosh", "tanh"}:
        return abs(x[0]) < 1e5
    if name == "pow":
        return abs(x[1]) < 1e4 and (x[0] == 0.0 or 1e-300 < x[0] < 1e300)
    return True


def encloses(result: Interval, exact: Exact) -> bool:
    """Whether an interval holds a number of any precision."""
    lo, hi = float(result.inf), float(result.sup)
    return bool((np.isinf(lo) or mpmath.mpf(lo) <= exact) and (np.isinf(hi) or exact <= hi))


@st.composite
def intervals_with_members(
    draw: st.DrawFn, ends: st.SearchStrategy[float] = EXTREME
) -> tuple[Interval, float]:
    """An interval and a number in it, often one of its ends."""
    lo, hi = sorted((draw(ends), draw(ends)))
    share = draw(st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.0, 1.0)))
    member = min(max(lo * (1.0 - share) + hi * share, lo), hi)
    return Interval(lo, hi), member
