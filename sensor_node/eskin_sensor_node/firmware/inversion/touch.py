"""Area, capacitance and energy of a touch (eq. 2, 10)."""

from eskin_sensor_node.firmware.inversion.capacitive import capacitance_bounds
from eskin_sensor_node.firmware.inversion.codes import code_bounds, scaled
from eskin_sensor_node.firmware.rounding import down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.inversion.codes import Adc, Bounds, Buffer, Codes


def measure_touch(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reaches: "Bounds",
    factor: "Bounds",
    area_factor: "Bounds",
    energy_factor: "Bounds",
    a_lo: "Buffer",
    a_hi: "Buffer",
    c_lo: "Buffer",
    c_hi: "Buffer",
    e_lo: "Buffer",
    e_hi: "Buffer",
) -> None:
    """Area ``C·d/ε`` in m², capacitance in F, energy ``½CV²`` in J (eq. 2, 10).

    The noise lies on the plate: ``reaches``: how far it moves an area and a capacitance.
    """
    for k in range(n):
        i_lo, i_hi = code_bounds(codes[k], last, adc, 0.0)
        lo, hi = capacitance_bounds(i_lo, i_hi, factor)
        low, high = scaled(lo, hi, area_factor)
        a_lo[k], a_hi[k] = down(low - reaches[0]), up(high + reaches[0])
        lo, hi = down(lo - reaches[1]), up(hi + reaches[1])
        c_lo[k], c_hi[k] = lo, hi
        e_lo[k], e_hi[k] = scaled(lo, hi, energy_factor)
