"""Constraints that samples of a pad make: ``C = C0·k·(1 + F/E + r)``, with k of the air.

F is the pressure that the pad feels, at least 0, and r what remains of the compression by earlier
loads (hysteresis), from 0 to a stated bound. F and E occur as their quotient only: a history of
unknown loads says nothing of E, and of ``C0 = ε0·εr·A/d0`` only the product.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import IdentificationError
from eskin.interval import Interval

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    Bounds = Interval | ArrayLike


def rest_capacitance(
    capacitance: Interval,
    permittivity: Bounds = 1.0,
    *,
    at_rest: ArrayLike = False,
    residual: float = 0.0,
) -> Interval:
    """Bounds of C0 by samples: from above by each, from below by those at rest.

    Args:
        capacitance: Samples in F. One that is not bounded on both sides says nothing: its converter
            saturates, and the line may be open.
        permittivity: k over the data sheet's, by the air of each sample.
        at_rest: Where the pad is certainly not loaded: nothing touches it or its neighbours, and no
            water lies on it.
        residual: Greatest r at rest.

    Returns:
        C0 in F at the samples' instants, within ``[0, inf]``, of the broadcast shape.

    Raises:
        IdentificationError: ``residual`` is negative, or the permittivity may not be positive.
    """
    air = _air(permittivity, residual)
    scaled = _known(capacitance) / air
    rest = scaled / (1.0 + Interval(0.0, residual))
    lower = np.where(np.asarray(at_rest, bool), rest.inf, 0.0)
    shape = np.broadcast_shapes(lower.shape, scaled.shape)
    return Interval(np.maximum(np.broadcast_to(lower, shape), 0.0), scaled.sup)


def stiffness(
    capacitance: Interval,
    load: Bounds,
    rest: Bounds,
    permittivity: Bounds = 1.0,
    *,
    residual: float = 0.0,
) -> Interval:
    """Bounds of the stiffness E by samples under known loads: ``E = F/(C/(C0·k) - 1 - r)``.

    Args:
        capacitance: Samples in F, as of `rest_capacitance`.
        load: F in Pa, what the pad feels, at least 0.
        rest: C0 in F. Errors that C and C0 share, as that of the oscillator, cancel: divide both by
            their factor α first (`eskin.monitor.SharedError`).
        permittivity: k over the data sheet's, by the air of each sample.
        residual: Greatest r.

    Returns:
        E in Pa at the samples' instants, within ``[0, inf]``, of the broadcast shape. A sample
        without a load says nothing, and neither does one that shows no strain.

    Raises:
        IdentificationError: ``residual`` is negative, or the permittivity, or C0, may not be
            positive, or a load may be negative.
    """
    pressure, zero_load = Interval.of(load), Interval.of(rest)
    if np.any(pressure.inf < 0.0):
        raise IdentificationError("a load may not be negative")
    if np.any(zero_load.inf <= 0.0):
        raise IdentificationError("a capacitance at rest must be positive")
    scaled = _known(capacitance) / (zero_load * _air(permittivity, residual))
    strain = scaled - 1.0 - Interval(0.0, residual)
    # A strain that is not positive contradicts the load: it says nothing, and nothing wrong.
    shown = strain.sup > 0.0
    positive = Interval(np.maximum(strain.inf, 0.0), np.where(shown, strain.sup, np.inf))
    found = pressure / positive
    informs = shown & (pressure.sup > 0.0)
    return Interval(
        np.where(informs, np.maximum(found.inf, 0.0), 0.0), np.where(informs, found.sup, np.inf)
    )


def _known(capacitance: Interval) -> Interval:
    """Capacitances that are bounded on both sides; of others all that is positive."""
    if np.any(capacitance.sup <= 0.0):
        raise IdentificationError("a capacitance must be positive")
    bounded = capacitance.is_common_interval
    return Interval(
        np.where(bounded, np.maximum(capacitance.inf, 0.0), 0.0),
        np.where(bounded, capacitance.sup, np.inf),
    )


def _air(permittivity: Bounds, residual: float) -> Interval:
    air = Interval.of(permittivity)
    if np.any(air.inf <= 0.0):
        raise IdentificationError("a permittivity over the data sheet's must be positive")
    if not residual >= 0.0:
        raise IdentificationError(f"residual must not be negative, not {residual!r}")
    return air
