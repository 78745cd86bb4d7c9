"""Relative humidity from the capacitance of a polymer that takes up water."""

from eskin_sensor_node.firmware.inversion.capacitive import capacitance_bounds
from eskin_sensor_node.firmware.inversion.codes import code_bounds
from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.inversion.codes import Adc, Bounds, Buffer, Codes

REFERENCE_HUMIDITY = 50.0
"""In %, where data sheets hold."""
_ALL = 100.0


def humidity_bounds(
    lo: float, hi: float, rest: "Bounds", sensitivity: "Bounds", error: float
) -> "Bounds":
    """``H = 50 % + (C/C50 - 1)/s``, and the polymer's error, within 0 and 100 %.

    Where nothing lies within, something is broken or noise went beyond its reach.
    """
    least, most = -INFINITY, INFINITY
    if lo > -INFINITY:
        change = down(down(lo / rest[1]) - 1.0)
        change = down(change / (sensitivity[1] if change >= 0.0 else sensitivity[0]))
        least = max(down(down(change + REFERENCE_HUMIDITY) - error), 0.0)
    if hi < INFINITY:
        change = up(up(hi / rest[0]) - 1.0)
        change = up(change / (sensitivity[0] if change >= 0.0 else sensitivity[1]))
        most = min(up(up(change + REFERENCE_HUMIDITY) + error), _ALL)
    if least > _ALL or most < 0.0:
        return -INFINITY, INFINITY
    return least, most


def moisture_bounds(
    code: int,
    last: int,
    adc: "Adc",
    reach: float,
    factor: "Bounds",
    rest: "Bounds",
    sensitivity: "Bounds",
    error: float,
) -> "Bounds":
    """Relative humidity in % from one code."""
    i_lo, i_hi = code_bounds(code, last, adc, reach)
    lo, hi = capacitance_bounds(i_lo, i_hi, factor)
    return humidity_bounds(lo, hi, rest, sensitivity, error)


def measure_humidity(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reach: float,
    factor: "Bounds",
    rest: "Bounds",
    sensitivity: "Bounds",
    error: float,
    h_lo: "Buffer",
    h_hi: "Buffer",
) -> None:
    """Relative humidity in %."""
    for k in range(n):
        h_lo[k], h_hi[k] = moisture_bounds(
            codes[k], last, adc, reach, factor, rest, sensitivity, error
        )
