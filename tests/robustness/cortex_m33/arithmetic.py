"""Cases of the arithmetic under everything: a directed rounding, a product, a quotient."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from eskin_sensor_node.firmware.calibration import product, quotient
from eskin_sensor_node.firmware.rounding import INFINITY, LEAST, MOST, down, up

from tests.robustness.cortex_m33.case import Case
from tests.robustness.cortex_m33.inversions import Count

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

_DRAWS: Final = 400
_EDGES: Final = (0.0, -0.0, LEAST, MOST, INFINITY, 2.0**-1022, 2.0**-1021, 2.0**-967, 2.0**-968)


def arithmetic() -> Iterator[Count]:
    """Numbers of all sizes; prices are of those that a sensor gives."""
    random = np.random.default_rng(5)
    powers = [2.0**k for k in range(-1074, 1024, 7)]
    near = [np.nextafter(x, way) for x in powers for way in (0.0, np.inf)]
    patterns = random.integers(0, 0x7FF0 << 48, _DRAWS, dtype=np.uint64).view(np.float64)
    for x in map(float, (*_EDGES, *powers, *near, *patterns)):
        name = "outward_rounding" if 2.0**-967 <= x < INFINITY else "outward_rounding_tiny"
        for signed in (x, -x):
            after = [signed, down(signed), up(signed)]
            case = Case.of("rounding", [signed, 0.0, 0.0], after=[after])
            yield Count(name, [case], 1)
    ratios = np.concatenate([random.lognormal(0.0, 8.0, (_DRAWS, 4)), _close(random)])
    for draw in ratios:
        a, b = _ordered(*draw[:2]), _ordered(*draw[2:])
        for name, found in (("product", product(a, b)), ("quotient", quotient(a, b))):
            case = Case.of(name, [*a, *b, 0.0, 0.0], after=[[*a, *b, *found]])
            yield Count(f"interval_{name}", [case], 1)
    yield from _any_size(random)


def _close(random: np.random.Generator) -> NDArray[np.float64]:
    """Numbers whose quotients are near one, near a tie, and of few digits."""
    whole = random.integers(1, 64, (_DRAWS, 4)).astype(np.float64)
    near = 1.0 + random.integers(0, 4, (_DRAWS, 4)) * 2.0**-52
    return np.concatenate([whole, near])


def _any_size(random: np.random.Generator) -> Iterator[Count]:
    """Quotients of any two floats: the compiler's division takes what is not normal."""
    patterns = random.integers(1, 0x7FF0 << 48, (_DRAWS, 4), dtype=np.uint64).view(np.float64)
    small = random.integers(1, 1 << 54, (_DRAWS, 4), dtype=np.uint64).view(np.float64)
    for draw in np.concatenate([patterns, small]):
        a, b = _ordered(*draw[:2]), _ordered(*draw[2:])
        case = Case.of("quotient", [*a, *b, 0.0, 0.0], after=[[*a, *b, *quotient(a, b)]])
        yield Count("interval_quotient_any", [case], 1)


def _ordered(one: float, other: float) -> tuple[float, float]:
    return min(float(one), float(other)), max(float(one), float(other))
