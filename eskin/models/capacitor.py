"""The plate capacitor: capacitance of a sensor (eq. 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.constants import VACUUM_PERMITTIVITY
from eskin.kernels.jit import kernel, part
from eskin.models.bounds import above, below
from eskin.models.broadcasting import BLOCK, block_count, evaluate, row_of
from eskin.models.parameters import GREATEST, LEAST, positive

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats


@part
def _positive(e: float, r: float, a: float, d: float) -> bool:
    least = (e >= LEAST) & (r >= LEAST) & (a >= LEAST) & (d >= LEAST)
    return least & (e <= GREATEST) & (r <= GREATEST) & (a <= GREATEST) & (d <= GREATEST)


@kernel
def _capacitance(operands: Operands, _limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((8, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        e, start = row_of(operands, 0, columns, block, work)
        r, _ = row_of(operands, 2, columns, block, work)
        a, _ = row_of(operands, 4, columns, block, work)
        d, _ = row_of(operands, 7, columns, block, work)
        lower = out[0][start : start + e.size]
        for i in range(e.size):
            allowed &= _positive(e[i], r[i], a[i], d[i])
            lower[i] = below(e[i] * r[i] * a[i] / d[i], 3)
        e, _ = row_of(operands, 1, columns, block, work)
        r, _ = row_of(operands, 3, columns, block, work)
        a, _ = row_of(operands, 5, columns, block, work)
        d, _ = row_of(operands, 6, columns, block, work)
        upper = out[1][start : start + e.size]
        for i in range(e.size):
            allowed &= _positive(e[i], r[i], a[i], d[i])
            upper[i] = above(e[i] * r[i] * a[i] / d[i], 3)
    return allowed


def capacitance(
    *,
    relative_permittivity: Bounds,
    area: Bounds,
    distance: Bounds,
    vacuum_permittivity: Bounds = VACUUM_PERMITTIVITY,
) -> Interval:
    """Capacitance ``C = ε₀ εᵣ A / d`` of two plates (eq. 2), with nature's ε₀.

    Monotone in every parameter: the bounds are exact but for rounding.

    Args:
        relative_permittivity: εᵣ, > 0.
        area: A in m², > 0.
        distance: d in m, > 0.
        vacuum_permittivity: ε₀ in F/m, > 0; the paper rounds it to 8.854e-12.

    Returns:
        C in F, of the broadcast shape.

    Raises:
        IntervalError: A parameter is not finite and > 0, or shapes do not fit each other.
    """
    parameters = [
        positive("vacuum_permittivity", vacuum_permittivity),
        positive("relative_permittivity", relative_permittivity),
        positive("area", area),
        positive("distance", distance),
    ]
    return evaluate(_capacitance, parameters, 1)[0]
