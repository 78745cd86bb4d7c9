"""What the air makes of a permittivity: ``k = 1 + a·(T - 20 °C) + b·(H - 50 %)``.

Air changes slowly: a sensor that is read along gives few codes again and again. So what a code
means is calculated once and remembered, in as many slots as there is room for; a code that takes
the slot of another one costs time, and nothing else.
"""

from eskin_sensor_node.firmware.inversion.humidity import REFERENCE_HUMIDITY, moisture_bounds
from eskin_sensor_node.firmware.inversion.temperature import temperature_bounds
from eskin_sensor_node.firmware.rounding import down, up

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


def measure_still(n: int, stated: "Bounds", k_lo: "Buffer", k_hi: "Buffer") -> None:
    """Begin with a permittivity over the data sheet's that is the same in all samples."""
    for k in range(n):
        k_lo[k], k_hi[k] = stated


def measure_warm(
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


def measure_moist(
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
    """Add to the permittivity what the humidity changes of it; as `measure_warm` otherwise."""
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
