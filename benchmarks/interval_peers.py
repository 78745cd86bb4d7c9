"""The same formulas in other interval libraries, each in its own way of working.

codac, mpmath and python-flint take one interval at a time; precise-numpy takes whole arrays.
codac leaves the processor rounding upward once it is imported, which costs numpy's sine half of
its speed: so it is let run so, and everything else to nearest.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import codac
import flint
import mpmath
import numpy as np
import precise_numpy

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from eskin.interval import Interval

    Values = Mapping[str, Any]


@dataclass(frozen=True)
class Library:
    """A library of intervals.

    Attributes:
        name: As it calls itself.
        interval: Makes an interval of its own out of two bounds: numbers, or arrays.
        sin: Its sine.
        exp: Its exponential.
        sqrt: Its square root.
        whole: Whether it takes whole arrays.
        elements: How many elements it is given, so that a run takes an instant.
        rounding: The processor's mode that it relies on.
    """

    name: str
    interval: Callable[[Any, Any], Any]
    sin: Callable[[Any], Any]
    exp: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    whole: bool
    elements: int
    rounding: int = 0


_C = ctypes.CDLL(None)
_UPWARD = _C.fegetround()
_C.fesetround(0)


def _ball(lo: float, hi: float) -> Any:
    return flint.arb(0.5 * (lo + hi), 0.5 * (hi - lo))


def _precise(lo: Any, hi: Any) -> Any:
    lows, highs = np.atleast_1d(lo), np.atleast_1d(hi)
    middle, radius = 0.5 * (lows + highs), 0.5 * (highs - lows)
    return precise_numpy.from_raw_parts(middle.tolist(), radius.tolist(), [middle.size])


NUMPY = Library("numpy", lambda lo, _: lo, np.sin, np.exp, np.sqrt, whole=True, elements=1_000_000)
PEERS = [
    Library(
        "codac",
        codac.Interval,
        codac.sin,
        codac.exp,
        codac.sqrt,
        whole=False,
        elements=20_000,
        rounding=_UPWARD,
    ),
    Library(
        "mpmath.iv",
        lambda lo, hi: mpmath.iv.mpf([lo, hi]),
        mpmath.iv.sin,
        mpmath.iv.exp,
        mpmath.iv.sqrt,
        whole=False,
        elements=1000,
    ),
    Library(
        "python-flint",
        _ball,
        lambda x: x.sin(),
        lambda x: x.exp(),
        lambda x: x.sqrt(),
        whole=False,
        elements=20_000,
    ),
    Library(
        "precise-numpy",
        _precise,
        precise_numpy.sin,
        precise_numpy.exp,
        precise_numpy.sqrt,
        whole=True,
        elements=200_000,
    ),
]


def capacitance(p: Values, _: Library) -> Any:
    """Eq. 2."""
    return p["relative_permittivity"] * p["area"] / p["distance"] * 8.8541878188e-12


def chain_current(p: Values, library: Library) -> Any:
    """Eq. 5, V and I, in the form in which no parameter counts twice."""
    s = library.sin(p["time"] * (4.0 * math.pi)) * 0.5 + 0.5
    return p["transconductance"] / ((1.0 - s) + s * p["ratio"])


def proximity_frequency(p: Values, library: Library) -> Any:
    """Eq. 11 to 13."""
    distance = library.sin(p["time"] * (2.0 * math.pi)) * p["amplitude"] + p["mean"]
    inductance = p["base"] - p["change"] * library.exp(-(p["damping"] * distance))
    return 1.0 / (library.sqrt(inductance * p["capacitance"]) * (2.0 * math.pi))


def prepare(
    formula: Callable[[Values, Library], Any], library: Library, values: Mapping[str, Interval]
) -> Callable[[], object]:
    """A call that evaluates a formula over the first elements; all inputs are made beforehand."""
    n = library.elements
    if library.whole:
        made = {k: library.interval(v.inf[:n], v.sup[:n]) for k, v in values.items()}
        return lambda: formula(made, library)
    points = [
        {k: library.interval(float(v.inf[i]), float(v.sup[i])) for k, v in values.items()}
        for i in range(n)
    ]

    def run() -> list[Any]:
        _C.fesetround(library.rounding)
        try:
            return [formula(point, library) for point in points]
        finally:
            _C.fesetround(0)

    return run
