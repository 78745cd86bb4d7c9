"""Frequency, inductance, and distance of metal (eq. 11, 12)."""

from eskin_sensor_node.firmware.inversion.codes import code_bounds, scaled
from eskin_sensor_node.firmware.logarithm import logarithm
from eskin_sensor_node.firmware.rounding import INFINITY, TWO_PI_HI, TWO_PI_LO, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.inversion.codes import Adc, Bounds, Buffer, Codes


def inductance_bounds(lo: float, hi: float, capacitance: "Bounds") -> "Bounds":
    """``L = 1 / ((2πf)²·C)`` from the frequency of eq. 12."""
    floor, ceiling = 0.0, INFINITY
    if hi > 0.0:
        omega = up(TWO_PI_HI * hi)
        floor = down(1.0 / up(up(omega * omega) * capacitance[1]))
    if lo > 0.0 and hi > 0.0:
        omega = down(TWO_PI_LO * lo)
        ceiling = up(1.0 / down(down(omega * omega) * capacitance[0]))
    return (-INFINITY if hi == INFINITY else floor), ceiling


def distance_bounds(lo: float, hi: float, coil: "tuple[Bounds, Bounds, Bounds]") -> "Bounds":
    """``d = -ln((L0 - L)/ΔL)/alpha`` from the inductance of eq. 11.

    Before the coil the ratio lies in (0, 1]. Where it does not, something is broken or noise went
    beyond its reach, and nothing is known.
    """
    base, change, damping = coil
    most, least = up(base[1] - lo), down(base[0] - hi)
    least = down(least / (change[1] if least >= 0.0 else change[0]))
    most = up(most / (change[0] if most >= 0.0 else change[1]))
    if most <= 0.0 or least > 1.0:
        return -INFINITY, INFINITY
    near, far = -INFINITY, INFINITY
    if lo > -INFINITY:
        near = 0.0 if most >= 1.0 else max(0.0, down(-logarithm(most)[1] / damping[1]))
    if least > 0.0:
        far = up(-logarithm(least)[0] / damping[0])
    return near, far


def measure_inductive(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reach: float,
    reference: "Bounds",
    capacitance: "Bounds",
    coil: "tuple[Bounds, Bounds, Bounds]",
    f_lo: "Buffer",
    f_hi: "Buffer",
    l_lo: "Buffer",
    l_hi: "Buffer",
    d_lo: "Buffer",
    d_hi: "Buffer",
) -> None:
    """Frequency in Hz, inductance in H, distance in m."""
    for k in range(n):
        v_lo, v_hi = code_bounds(codes[k], last, adc, reach)
        lo, hi = scaled(v_lo, v_hi, reference)
        f_lo[k], f_hi[k] = lo, hi
        lo, hi = inductance_bounds(lo, hi, capacitance)
        l_lo[k], l_hi[k] = lo, hi
        d_lo[k], d_hi[k] = distance_bounds(lo, hi, coil)
