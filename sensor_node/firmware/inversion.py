"""From ADC codes back to quantities: each result encloses the truth.

Known are the parts' tolerances, the converter's errors, and the noise's reach. A saturated code
leaves the side open that it does not bound, on every quantity that follows from it.

Each function fills buffers sample by sample, as an interrupt's buffer is worked off. Calibrations
are tuples of floats that `sensor_node.firmware.calibration` makes.
"""

from sensor_node.firmware.logarithm import logarithm
from sensor_node.firmware.rounding import INFINITY, TWO_PI_HI, TWO_PI_LO, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import MutableSequence, Sequence

    Buffer = MutableSequence[float]
    Codes = Sequence[int]
    Bounds = tuple[float, float]


def code_bounds(
    code: int, last: int, adc: "tuple[float, float, float, float, float]", reach: float
) -> "Bounds":
    """What the input may have been: ``(code + [-inl, 1 + inl])·step + offset``, and noise."""
    step_lo, step_hi, offset_lo, offset_hi, nonlinearity = adc
    low, high = down(code - nonlinearity), up(code + 1 + nonlinearity)
    lo = down(low * (step_lo if low >= 0.0 else step_hi))
    hi = up(high * (step_hi if high >= 0.0 else step_lo))
    return (
        -INFINITY if code <= 0 else down(down(lo + offset_lo) - reach),
        INFINITY if code >= last else up(up(hi + offset_hi) + reach),
    )


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
    adc: "tuple[float, float, float, float, float]",
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


def scaled(lo: float, hi: float, factor: "Bounds") -> "Bounds":
    """A product with a positive factor."""
    return (
        down(lo * (factor[0] if lo >= 0.0 else factor[1])),
        up(hi * (factor[1] if hi >= 0.0 else factor[0])),
    )


def measure_touch(
    codes: "Codes",
    n: int,
    last: int,
    adc: "tuple[float, float, float, float, float]",
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

    The noise lies on the plate: ``reaches`` tells how far it moves an area and a capacitance.
    """
    for k in range(n):
        i_lo, i_hi = code_bounds(codes[k], last, adc, 0.0)
        lo, hi = capacitance_bounds(i_lo, i_hi, factor)
        low, high = scaled(lo, hi, area_factor)
        a_lo[k], a_hi[k] = down(low - reaches[0]), up(high + reaches[0])
        lo, hi = down(lo - reaches[1]), up(hi + reaches[1])
        c_lo[k], c_hi[k] = lo, hi
        e_lo[k], e_hi[k] = scaled(lo, hi, energy_factor)


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
    adc: "tuple[float, float, float, float, float]",
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


def measure_amplified(
    codes: "Codes",
    n: int,
    last: int,
    adc: "tuple[float, float, float, float, float]",
    reach: float,
    gain: "Bounds",
    lo: "Buffer",
    hi: "Buffer",
) -> None:
    """A quantity behind an amplifier: the input divided by the gain."""
    for k in range(n):
        v_lo, v_hi = code_bounds(codes[k], last, adc, reach)
        lo[k] = down(v_lo / (gain[1] if v_lo >= 0.0 else gain[0]))
        hi[k] = up(v_hi / (gain[0] if v_hi >= 0.0 else gain[1]))
