"""Where the energy goes: supercapacitor, MOSFET, MagFES, EcFES and losses (Fig. 2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.kernels.jit import kernel, part
from eskin.models.bounds import above, below
from eskin.models.broadcasting import BLOCK, block_count, evaluate, load
from eskin.models.charging import (
    BURNT_PEAK,
    FILLED_PEAK,
    ROUNDINGS,
    burnt,
    drawn,
    filled,
    most_burnt,
)
from eskin.models.parameters import Allowed, parameter

if TYPE_CHECKING:
    from eskin.interval import Interval
    from eskin.models.broadcasting import Operands, Results
    from eskin.models.parameters import Bounds, Floats

_POSITIVE: Final = Allowed(1e-24, 1e24, 1e-24, "> 0, from 1e-24 to 1e+24")
_NOT_NEGATIVE: Final = Allowed(1e-24, 1e24, 0.0, "0 or from 1e-24 to 1e+24")
_MARGIN: Final = ROUNDINGS + 24


@dataclass(frozen=True, slots=True)
class EnergyFlow:
    """Energies in J since the switch closed. ``supplied = stored + loss`` for every draw.

    Attributes:
        supplied: E_in, what the supercapacitor gave.
        magnetic: ½ L i² in the coil (MagFES).
        electric: ½ C u² in the capacitor (EcFES).
        stored: E_store, the sum of both.
        switch_loss: Heat in the MOSFET.
        coil_loss: Heat in the coil.
        capacitor_loss: Heat in the resistance before the capacitor.
        loss: E_loss, the sum of the three.
    """

    supplied: Interval
    magnetic: Interval
    electric: Interval
    stored: Interval
    switch_loss: Interval
    coil_loss: Interval
    capacitor_loss: Interval
    loss: Interval


@part
def _least_stored(t: float, r: float, x_inf: float, x_sup: float) -> float:
    """``½ (t/r)·min x·filled(x)``: it has one maximum, so an end is least."""
    return 0.5 * (t / r) * min(x_inf * filled(x_inf), x_sup * filled(x_sup))


@part
def _most_stored(t: float, r: float, x_inf: float, x_sup: float) -> float:
    x = min(max(FILLED_PEAK, x_inf), x_sup)
    return 0.5 * (t / r) * (x * filled(x))


@kernel
def _energy_flow(operands: Operands, limits: Floats, columns: int, out: Results) -> bool:
    work = np.empty((24, BLOCK))
    allowed = True
    for block in range(block_count(columns, out)):
        start, n, good = load(operands, limits, columns, block, work)
        allowed &= good
        for i in range(n):
            _coil_down(work, i)
            _coil_up(work, i)
            _write(work, i, out, start + i)
    return allowed


@part
def _coil_down(work: Floats, i: int) -> None:
    """Lower bounds of the coil's branch at 1 V, into rows 14 to 18.

    All fall with either resistance but the heats, and all but the stored energy with L.
    """
    t, switch, coil = work[12, i], work[3, i], work[5, i]
    l_inf, l_sup = work[6, i], work[7, i]
    r = switch + coil
    x = r * t / l_sup
    work[14, i] = (t / r) * (x * drawn(x))
    work[15, i] = _least_stored(t, r, x, r * t / l_inf)
    rate, scale = t / l_sup, (t / l_sup) * t
    x_inf = (work[2, i] + work[4, i]) * rate
    work[16, i] = scale * min(x_inf * burnt(x_inf), x * burnt(x))
    scale *= t / l_sup
    least, most = work[2, i], switch
    heat = min(least * burnt((least + coil) * rate), most * burnt((most + coil) * rate))
    work[17, i] = scale * heat
    least, most = work[4, i], coil
    heat = min(least * burnt((least + switch) * rate), most * burnt((most + switch) * rate))
    work[18, i] = scale * heat


@part
def _coil_up(work: Floats, i: int) -> None:
    """Upper bounds of the coil's branch at 1 V, into rows 19 to 23."""
    t, switch, coil = work[13, i], work[2, i], work[4, i]
    l_inf, l_sup = work[6, i], work[7, i]
    r = switch + coil
    x = r * t / l_inf
    work[19, i] = (t / r) * (x * drawn(x))
    work[20, i] = _most_stored(t, r, r * t / l_sup, x)
    rate, scale = t / l_inf, (t / l_inf) * t
    peak = min(max(BURNT_PEAK, x), (work[3, i] + work[5, i]) * rate)
    work[21, i] = scale * (peak * burnt(peak))
    scale *= t / l_inf
    work[22, i] = scale * most_burnt(switch, work[3, i], coil, rate)
    work[23, i] = scale * most_burnt(coil, work[5, i], switch, rate)


@part
def _capacitor_at(t: float, r: float, c: float) -> tuple[float, float]:
    """What the capacitor's branch draws and burns at 1 V: both grow with C and fall with R."""
    y = t / (r * c)
    return -c * math.expm1(-y), -0.5 * c * math.expm1(-2.0 * y)


@part
def _write(work: Floats, i: int, out: Results, at: int) -> None:
    """All results: the branches share the voltage alone, so their bounds add up."""
    square = work[0, i] * work[0, i]
    t, r = work[12, i], work[9, i]
    supplied, heat = _capacitor_at(t, r, work[10, i])
    electric = _least_stored(t, r, t / (r * work[11, i]), t / (r * work[10, i]))
    out[0][at] = below(square * (work[14, i] + supplied), _MARGIN)
    out[2][at] = below(square * work[15, i], _MARGIN)
    out[4][at] = below(square * electric, _MARGIN)
    out[6][at] = below(square * (work[15, i] + electric), _MARGIN)
    out[8][at] = below(square * work[17, i], _MARGIN)
    out[10][at] = below(square * work[18, i], _MARGIN)
    out[12][at] = below(square * heat, _MARGIN)
    out[14][at] = below(square * (work[16, i] + heat), _MARGIN)
    square = work[1, i] * work[1, i]
    t, r = work[13, i], work[8, i]
    supplied, heat = _capacitor_at(t, r, work[11, i])
    electric = _most_stored(t, r, t / (r * work[11, i]), t / (r * work[10, i]))
    out[1][at] = above(square * (work[19, i] + supplied), _MARGIN)
    out[3][at] = above(square * work[20, i], _MARGIN)
    out[5][at] = above(square * electric, _MARGIN)
    out[7][at] = above(square * (work[20, i] + electric), _MARGIN)
    out[9][at] = above(square * work[22, i], _MARGIN)
    out[11][at] = above(square * work[23, i], _MARGIN)
    out[13][at] = above(square * heat, _MARGIN)
    out[15][at] = above(square * (work[21, i] + heat), _MARGIN)


def energy_flow(
    time: Bounds,
    *,
    voltage: Bounds,
    switch_resistance: Bounds,
    coil_resistance: Bounds,
    inductance: Bounds,
    capacitor_resistance: Bounds,
    capacitance: Bounds,
) -> EnergyFlow:
    """Energy flow of Fig. 2, since the supercapacitor was switched on to coil and capacitor.

    The supercapacitor holds the voltage V. Through the MOSFET (its on-resistance) and the coil's
    resistance it drives ``i = V/R·(1 - e^(-R t/L))`` into MagFES, and through a resistance it fills
    EcFES, ``u = V·(1 - e^(-t/(R C)))``. ``E_in = E_store + E_loss`` holds for every draw of the
    parameters, and each interval encloses its energy for all of them. After the switch opens,
    `eskin.models.coil_energy.coil_energy` computes how the coil loses what it holds.

    Bounds are exact but for rounding: every energy is monotone in each parameter, or has one
    maximum, which is found. The paper draws this flow and gives no equations beyond the balance.

    Args:
        time: t in s since the switch closed, >= 0.
        voltage: V in V, >= 0.
        switch_resistance: On-resistance of the MOSFET in Ω, > 0.
        coil_resistance: Resistance of the coil in Ω, > 0.
        inductance: L in H, > 0.
        capacitor_resistance: Resistance before the capacitor in Ω, > 0.
        capacitance: C in F, > 0.

    Returns:
        The energies, each of the broadcast shape.

    Raises:
        IntervalError: A parameter is not allowed, or shapes do not fit each other.
    """
    parameters = [
        parameter("voltage", voltage, _NOT_NEGATIVE),
        parameter("switch_resistance", switch_resistance, _POSITIVE),
        parameter("coil_resistance", coil_resistance, _POSITIVE),
        parameter("inductance", inductance, _POSITIVE),
        parameter("capacitor_resistance", capacitor_resistance, _POSITIVE),
        parameter("capacitance", capacitance, _POSITIVE),
        parameter("time", time, _NOT_NEGATIVE),
    ]
    return EnergyFlow(*evaluate(_energy_flow, parameters, 8))
