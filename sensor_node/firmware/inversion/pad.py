"""What presses a pad: two plates with an elastic layer between them.

``C = ε0·εr·k·A/d`` with ``k = 1 + a·(T - 20 °C) + b·(H - 50 %)``; the layer's mean distance is ``d
= d0/(1 + F/E)`` under the mean pressure F that the pad feels: its own P, and what neighbours hand
on, at most a share of the greatest pressure of a contact (eq. 2, 9, 10).

One capacitance cannot tell a small contact that presses hard from a large one that presses
lightly. So the contact area is bounded by two statements of the data sheet: no contact presses
with more than the greatest pressure (from below), and none covers more than the plate.
"""

from sensor_node.firmware.inversion.capacitive import capacitance_bounds
from sensor_node.firmware.inversion.codes import code_bounds
from sensor_node.firmware.inversion.humidity import REFERENCE_HUMIDITY
from sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sensor_node.firmware.inversion.codes import Adc, Bounds, Buffer, Codes

REFERENCE_TEMPERATURE = 20.0
"""In °C, where data sheets hold."""


def change_bounds(lo: float, hi: float, reference: float, slope: float) -> "Bounds":
    """``slope·(x - reference)``, of any sign."""
    if slope == 0.0:
        return 0.0, 0.0
    below, above = down(lo - reference), up(hi - reference)
    if slope > 0.0:
        return down(slope * below), up(slope * above)
    return down(slope * above), up(slope * below)


def measure_permittivity(
    n: int,
    slopes: "Bounds",
    t_lo: "Buffer",
    t_hi: "Buffer",
    h_lo: "Buffer",
    h_hi: "Buffer",
    k_lo: "Buffer",
    k_hi: "Buffer",
) -> None:
    """Permittivity over the data sheet's, in air of a temperature in °C and a humidity in %.

    Args:
        n: Samples.
        slopes: Relative change for each K and for each %, each of any sign.
        t_lo: Lower bounds of the temperature.
        t_hi: Upper ones.
        h_lo: Lower bounds of the humidity.
        h_hi: Upper ones.
        k_lo: Where the lower bounds go.
        k_hi: Where the upper ones go.
    """
    for k in range(n):
        warm_lo, warm_hi = change_bounds(t_lo[k], t_hi[k], REFERENCE_TEMPERATURE, slopes[0])
        wet_lo, wet_hi = change_bounds(h_lo[k], h_hi[k], REFERENCE_HUMIDITY, slopes[1])
        k_lo[k] = down(down(1.0 + warm_lo) + wet_lo)
        k_hi[k] = up(up(1.0 + warm_hi) + wet_hi)


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


def measure_pad(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
    reach: float,
    factor: "Bounds",
    pad: "tuple[Bounds, Bounds, Bounds, Bounds, float, float]",
    k_lo: "Buffer",
    k_hi: "Buffer",
    c_lo: "Buffer",
    c_hi: "Buffer",
    i_lo: "Buffer",
    i_hi: "Buffer",
    d_lo: "Buffer",
    d_hi: "Buffer",
    a_lo: "Buffer",
    a_hi: "Buffer",
    p_lo: "Buffer",
    p_hi: "Buffer",
) -> None:
    """Capacitance in F, current in A, mean distance in m, contact area in m², mean pressure in Pa.

    ``pad``: ε0·εr·A, A, d0, E, the greatest pressure of a contact, what neighbours hand on.
    """
    plates, area, rest, elasticity, most, handed = pad
    for k in range(n):
        i_lo[k], i_hi[k] = lo, hi = code_bounds(codes[k], last, adc, reach)
        c_lo[k], c_hi[k] = lo, hi = capacitance_bounds(lo, hi, factor)
        d_lo[k], d_hi[k] = lo, hi = plate_distance_bounds(lo, hi, k_lo[k], k_hi[k], plates)
        lo, hi = felt_bounds(lo, hi, rest, elasticity)
        lo = down(lo - handed)
        if hi < 0.0 or lo > most:
            # Something is broken, or noise went beyond its reach: nothing is known.
            p_lo[k] = a_lo[k] = -INFINITY
            p_hi[k] = a_hi[k] = INFINITY
            continue
        open_below = lo == -INFINITY
        lo = max(lo, 0.0)
        p_lo[k], p_hi[k] = (-INFINITY if open_below else lo), hi
        a_lo[k] = -INFINITY if open_below else max(down(down(lo / most) * area[0]), 0.0)
        a_hi[k] = area[1]
