"""Temperature of a platinum resistor in a divider (IEC 60751).

``R/R0 = 1 + A·t + B·t² + C·(t - 100)·t³``, the last term below 0 °C only (Callendar, Van Dusen).
Without it ``t = 2·y / (A + √(A² + 4·B·y))`` with ``y = R/R0 - 1``; with it, y grows by ``h(t) =
-C·(t - 100)·t³``, which falls with t: each bound of t bounds h, and so the other bound of t.
"""

from math import sqrt

from eskin_sensor_node.firmware.inversion.codes import code_bounds
from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.inversion.codes import Adc, Bounds, Buffer, Codes

A = 39083 / 10000000
"""In 1/°C; IEC 60751, as the next two."""
B = -5775 / 10000000000
C = -4183 / 1000000000000000
_COLDEST, _COLD = -0.8, -190.0
"""R/R0 - 1 below which it is colder than so many °C; the norm ends at -200 °C."""
_HOTTEST, _HOT = 2.9, 840.0
"""Likewise above; the norm ends at 850 °C."""
_ROUNDS = 3
_SLACK = 1.0 / 281474976710656
"""2^-48, relative: nothing here suffers more than 10 roundings of 2^-53 (the difference under the
root is more than half of A², and doubles what its parts suffered)."""


def root_bounds(y: float) -> "Bounds":
    """Bounds of ``2·y / (A + √(A² + 4·B·y))``, for y within the norm."""
    t = 2.0 * y / (A + sqrt(A * A + 4.0 * B * y))
    slack = _SLACK * abs(t)
    return down(t - slack), up(t + slack)


def cubic(t: float) -> float:
    """``h(t)`` of a temperature below zero, nearly."""
    return -C * (t - 100.0) * t * t * t


def celsius_bounds(y: float) -> "Bounds":
    """Bounds of the temperature in °C at which ``R/R0 = 1 + y``."""
    if y < _COLDEST:
        return -INFINITY, _COLD
    if y > _HOTTEST:
        return _HOT, INFINITY
    lo, hi = root_bounds(y)
    if lo < 0.0:
        for _ in range(_ROUNDS):
            most = cubic(lo)
            hi = root_bounds(up(y + up(most + _SLACK * most)))[1]
            least = cubic(min(hi, 0.0))
            lo = root_bounds(down(y + down(least - _SLACK * least)))[0]
    return lo, hi


def excess_bounds(lo: float, hi: float, divider: "Bounds") -> "Bounds":
    """``R/R0 - 1`` from the share of the supply that a divider leaves: ``R = Rs·v / (1 - v)``."""
    least, most = -INFINITY, INFINITY
    if lo > -INFINITY:
        lo = min(max(lo, 0.0), 1.0)
        least = INFINITY if lo == 1.0 else down(down(divider[0] * down(lo / up(1.0 - lo))) - 1.0)
    if hi < 1.0:
        hi = max(hi, 0.0)
        most = up(up(divider[1] * up(hi / down(1.0 - hi))) - 1.0)
    return least, most


def temperature_bounds(
    code: int, last: int, adc: "Adc", reach: float, divider: "Bounds", tolerance: "Bounds"
) -> "Bounds":
    """Temperature in °C from one code; arguments as of `measure_temperature`."""
    v_lo, v_hi = code_bounds(code, last, adc, reach)
    least, most = excess_bounds(v_lo, v_hi, divider)
    lo, hi = celsius_bounds(least)[0], celsius_bounds(most)[1]
    return (
        down(lo - up(tolerance[0] + up(tolerance[1] * abs(lo)))),
        up(hi + up(tolerance[0] + up(tolerance[1] * abs(hi)))),
    )


def measure_temperature(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reach: float,
    divider: "Bounds",
    tolerance: "Bounds",
    t_lo: "Buffer",
    t_hi: "Buffer",
) -> None:
    """Temperature in °C.

    Args:
        codes: Of the divider's share of the supply.
        n: Samples.
        last: The greatest code.
        adc: The converter.
        reach: Of the noise.
        divider: Series resistor over the resistor's own at 0 °C.
        tolerance: The resistor's deviation: constant in K, and for each K away from 0 °C.
        t_lo: Lower bounds.
        t_hi: Upper bounds.
    """
    for k in range(n):
        t_lo[k], t_hi[k] = temperature_bounds(codes[k], last, adc, reach, divider, tolerance)
