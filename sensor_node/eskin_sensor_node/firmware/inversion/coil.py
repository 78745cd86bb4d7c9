"""What eddy currents in metal make of a coil's current, measured by synchronous demodulation.

A coil that is driven with ``V·sin ωt`` draws ``V/Z``. Two demodulators give the current's parts in
phase with the drive and a quarter behind it, ``i = G·V·Re(1/Z)`` and ``q = -G·V·Im(1/Z)``. Against
the coil without metal, ``Z0 = R + jωL0``, the amplitude changes by ``√(i² + q²)·|Z0|/(G·V)``, and
the phase by ``arg Z0 - arg Z = atan(i/q) - atan(R/(ωL0))``.
"""

from math import sqrt

from eskin_sensor_node.firmware.arctangent import arctangent
from eskin_sensor_node.firmware.inversion.codes import code_bounds
from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.inversion.codes import Adc, Bounds, Buffer, Codes


def modulus_bounds(i_lo: float, i_hi: float, q_lo: float, q_hi: float) -> "Bounds":
    """``√(i² + q²)``."""
    i_least, q_least = max(i_lo, -i_hi, 0.0), max(q_lo, -q_hi, 0.0)
    i_most, q_most = max(-i_lo, i_hi), max(-q_lo, q_hi)
    below = down(down(i_least * i_least) + down(q_least * q_least))
    above = up(up(i_most * i_most) + up(q_most * q_most))
    return max(down(sqrt(max(below, 0.0))), 0.0), up(sqrt(above))


def lag_bounds(i_lo: float, i_hi: float, q_lo: float, q_hi: float) -> "Bounds":
    """``atan(i/q)`` for ``q > 0``, in rad; where q may be less, nothing is known."""
    if q_lo <= 0.0:
        return -INFINITY, INFINITY
    least = down(i_lo / (q_hi if i_lo >= 0.0 else q_lo))
    most = up(i_hi / (q_lo if i_hi >= 0.0 else q_hi))
    return arctangent(least)[0], arctangent(most)[1]


def measure_eddy(
    in_phase: "Codes",
    quadrature: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reach: float,
    modulus: "Bounds",
    lag: "Bounds",
    a_lo: "Buffer",
    a_hi: "Buffer",
    p_lo: "Buffer",
    p_hi: "Buffer",
) -> None:
    """The current's amplitude over the one without metal, and its change of phase in rad.

    ``modulus``: ``|Z0|/(G·V)``; ``lag``: ``atan(R/(ωL0))``.
    """
    for k in range(n):
        i_lo, i_hi = code_bounds(in_phase[k], last, adc, reach)
        q_lo, q_hi = code_bounds(quadrature[k], last, adc, reach)
        lo, hi = modulus_bounds(i_lo, i_hi, q_lo, q_hi)
        a_lo[k] = max(down(lo * modulus[0]), 0.0)
        a_hi[k] = up(hi * modulus[1])
        lo, hi = lag_bounds(i_lo, i_hi, q_lo, q_hi)
        p_lo[k], p_hi[k] = down(lo - lag[1]), up(hi - lag[0])
