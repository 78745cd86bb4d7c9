"""Capacitance and current, over the chain of Fig. 3 (eq. 6)."""

from eskin_sensor_node.firmware.inversion.codes import code_bounds
from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.inversion.codes import Adc, Bounds, Buffer, Codes


def capacitance_bounds(lo: float, hi: float, factor: "Bounds") -> "Bounds":
    """``C = factor / I``: the oscillator's capacitance from the current of Fig. 3 (eq. 6)."""
    floor = 0.0 if hi <= 0.0 else down(factor[0] / hi)
    return (
        -INFINITY if hi == INFINITY else floor,
        INFINITY if lo <= 0.0 or hi <= 0.0 else up(factor[1] / lo),
    )


def measure_capacitive(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reach: float,
    factor: "Bounds",
    c_lo: "Buffer",
    c_hi: "Buffer",
    i_lo: "Buffer",
    i_hi: "Buffer",
) -> None:
    """Capacitance in F, and current in A."""
    for k in range(n):
        lo, hi = code_bounds(codes[k], last, adc, reach)
        i_lo[k], i_hi[k] = lo, hi
        c_lo[k], c_hi[k] = capacitance_bounds(lo, hi, factor)
