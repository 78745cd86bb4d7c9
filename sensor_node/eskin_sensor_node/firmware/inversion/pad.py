"""What presses a pad: two plates with an elastic layer between them.

``C = ε0·εr·k·A/d`` with ``k = 1 + a·(T - 20 °C) + b·(H - 50 %)``; the layer's mean distance is ``d
= d0/(1 + F/E)`` under the mean pressure F that the pad feels (eq. 2, 9, 10): its own P, and of the
mean of its neighbours' own a share that is between nothing and its crosstalk. A neighbour's own
pressure is at most what that one feels; this bound depends on no third pad, so that one pass over
the neighbours is as good as any iteration.

One capacitance does not separate a small contact that presses hard from a large one that presses
lightly. So the contact area is bounded by two statements of the data sheet: no contact presses
with more than the greatest pressure (from below), and none covers more than the plate.

Air changes slowly: its sensors give few codes again and again. So what a code means is calculated
once and remembered, in as many slots as there is room for; a code that takes the slot of another
one costs time, and nothing else.
"""

from eskin_sensor_node.firmware.inversion.capacitive import capacitance_bounds
from eskin_sensor_node.firmware.inversion.codes import code_bounds
from eskin_sensor_node.firmware.inversion.hygrometer import REFERENCE_HUMIDITY, moisture_bounds
from eskin_sensor_node.firmware.inversion.thermometer import temperature_bounds
from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import MutableSequence

    from eskin_sensor_node.firmware.inversion.codes import Adc, Bounds, Buffer, Codes

REFERENCE_TEMPERATURE = 20.0
"""In °C, where data sheets hold."""
UNUSED = -1
"""The code of a slot that remembers nothing."""


def change_bounds(lo: float, hi: float, reference: float, slope: "Bounds") -> "Bounds":
    """``slope·(x - reference)``; no end of the slope lies across zero from the other."""
    least, most = slope
    if least == 0.0 and most == 0.0:
        return 0.0, 0.0
    below, above = down(lo - reference), up(hi - reference)
    if least >= 0.0:
        return (
            down((least if below >= 0.0 else most) * below),
            up((most if above >= 0.0 else least) * above),
        )
    return (
        down((least if above >= 0.0 else most) * above),
        up((most if below >= 0.0 else least) * below),
    )


def measure_permittivity(n: int, stated: "Bounds", k_lo: "Buffer", k_hi: "Buffer") -> None:
    """Begin with a permittivity over the data sheet's that is the same in all samples."""
    for k in range(n):
        k_lo[k], k_hi[k] = stated


def measure_thermal_change(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reach: float,
    divider: "Bounds",
    tolerance: "Bounds",
    slope: "Bounds",
    known: "MutableSequence[int]",
    lows: "Buffer",
    highs: "Buffer",
    k_lo: "Buffer",
    k_hi: "Buffer",
) -> int:
    """Add to the permittivity what the temperature changes of it.

    Args:
        codes: Of the thermometer, as of `measure_temperature`.
        n: Samples.
        last: The greatest code.
        adc: The converter.
        reach: Of the noise.
        divider: Series resistor over the resistor's own at 0 °C.
        tolerance: The resistor's deviation.
        slope: Relative change for each K.
        known: The code that each slot remembers.
        lows: Lower bounds of what it changes.
        highs: Upper ones.
        k_lo: Lower bounds of the permittivity.
        k_hi: Upper ones.

    Returns:
        How many codes had to be calculated.
    """
    new = 0
    for k in range(n):
        code = codes[k]
        slot = code % len(known)
        if known[slot] != code:
            lo, hi = temperature_bounds(code, last, adc, reach, divider, tolerance)
            lows[slot], highs[slot] = change_bounds(lo, hi, REFERENCE_TEMPERATURE, slope)
            known[slot] = code
            new += 1
        k_lo[k], k_hi[k] = down(k_lo[k] + lows[slot]), up(k_hi[k] + highs[slot])
    return new


def measure_humidity_change(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reach: float,
    factor: "Bounds",
    rest: "Bounds",
    sensitivity: "Bounds",
    error: float,
    slope: "Bounds",
    known: "MutableSequence[int]",
    lows: "Buffer",
    highs: "Buffer",
    k_lo: "Buffer",
    k_hi: "Buffer",
) -> int:
    """Add what the humidity changes of it; as `measure_thermal_change` otherwise."""
    new = 0
    for k in range(n):
        code = codes[k]
        slot = code % len(known)
        if known[slot] != code:
            lo, hi = moisture_bounds(code, last, adc, reach, factor, rest, sensitivity, error)
            lows[slot], highs[slot] = change_bounds(lo, hi, REFERENCE_HUMIDITY, slope)
            known[slot] = code
            new += 1
        k_lo[k], k_hi[k] = down(k_lo[k] + lows[slot]), up(k_hi[k] + highs[slot])
    return new


def plate_distance_bounds(
    lo: float, hi: float, k_lo: float, k_hi: float, plates: "Bounds"
) -> "Bounds":
    """``d = ε0·εr·A·k/C``: the mean distance (harmonic, over the plate) in m."""
    near, far = -INFINITY, INFINITY
    if hi < INFINITY and k_lo > 0.0:
        near = down(down(plates[0] * k_lo) / hi)
    if lo > 0.0 and k_hi < INFINITY:
        far = up(up(plates[1] * k_hi) / lo)
    return near, far


def felt_bounds(near: float, far: float, rest: "Bounds", elasticity: "Bounds") -> "Bounds":
    """``F = E·(d0/d - 1)``: the pressure that a pad feels, in Pa."""
    least, most = -INFINITY, INFINITY
    if far < INFINITY:
        ratio = down(down(rest[0] / far) - 1.0)
        least = down(ratio * (elasticity[0] if ratio >= 0.0 else elasticity[1]))
    if near > 0.0:
        ratio = up(up(rest[1] / near) - 1.0)
        most = up(ratio * (elasticity[1] if ratio >= 0.0 else elasticity[0]))
    return least, most


def measure_felt(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reach: float,
    factor: "Bounds",
    pad: "tuple[Bounds, Bounds, Bounds]",
    c_lo: "Buffer",
    c_hi: "Buffer",
    i_lo: "Buffer",
    i_hi: "Buffer",
    d_lo: "Buffer",
    d_hi: "Buffer",
    p_lo: "Buffer",
    p_hi: "Buffer",
) -> None:
    """Capacitance in F, current in A, mean distance in m, pressure that the pad feels in Pa.

    The distance's buffers bring the permittivity over the data sheet's. ``pad``: ε0·εr·A, d0, E.
    """
    plates, rest, elasticity = pad
    for k in range(n):
        i_lo[k], i_hi[k] = lo, hi = code_bounds(codes[k], last, adc, reach)
        c_lo[k], c_hi[k] = lo, hi = capacitance_bounds(lo, hi, factor)
        d_lo[k], d_hi[k] = lo, hi = plate_distance_bounds(lo, hi, d_lo[k], d_hi[k], plates)
        p_lo[k], p_hi[k] = felt_bounds(lo, hi, rest, elasticity)


def measure_unknown(n: int, most: float, missing: int, total: "Buffer", least: "Buffer") -> None:
    """Begin with neighbours of which nothing is known: each may be pressed as hard as any."""
    for k in range(n):
        total[k], least[k] = up(missing * most), most


def measure_neighbour(
    n: int, most: float, felt_lo: "Buffer", felt_hi: "Buffer", total: "Buffer", least: "Buffer"
) -> None:
    """Add how hard a neighbour is pressed at most: as hard as it feels; and the least of all."""
    for k in range(n):
        above = felt_hi[k]
        if felt_lo[k] == -INFINITY or above > most or above < 0.0:
            above = most
        total[k] = up(total[k] + above)
        least[k] = min(least[k], above)


def measure_pressure(
    n: int,
    area: "Bounds",
    most: float,
    crosstalk: "tuple[float, int, float]",
    a_lo: "Buffer",
    a_hi: "Buffer",
    p_lo: "Buffer",
    p_hi: "Buffer",
) -> None:
    """Contact area in m² and mean pressure in Pa, out of what is felt.

    The area's buffers bring the least of what presses a neighbour, and the sum over all of them;
    the pressure's, what is felt. ``crosstalk``: the share that each neighbour hands on; how many of
    them may be broken, and give nothing; what all may hand on together, in Pa.
    """
    share, doubtful, most_handed = crosstalk
    for k in range(n):
        handed = up(share * up(a_hi[k] + up(doubtful * up(most - a_lo[k]))))
        lo, hi = down(p_lo[k] - min(handed, most_handed)), p_hi[k]
        if hi < 0.0 or lo > most:
            # Something is broken, or noise went beyond its reach: nothing is known.
            p_lo[k] = a_lo[k] = -INFINITY
            p_hi[k] = a_hi[k] = INFINITY
            continue
        open_below = lo == -INFINITY
        lo = max(lo, 0.0)
        p_lo[k] = -INFINITY if open_below else lo
        a_lo[k] = -INFINITY if open_below else max(down(down(lo / most) * area[0]), 0.0)
        a_hi[k] = area[1]
