"""An enclosure of the arc tangent from the four operations and the square root alone.

No port's own arc tangent will do: they differ in the last digit. With ``atan x = π/2 - atan(1/x)``
above 1, and twice ``atan x = 2·atan(x / (1 + √(1 + x²)))``, x is at most tan(π/16) < 1/5, and::

    atan x = x - x³/3 + x⁵/5 - …

The series is cut after x²³/23; what is left out is below ``x²⁵/25 < 2^-60·x``.
"""

from math import sqrt

from eskin_sensor_node.firmware.rounding import LEAST, TWO_PI_LO, down, up

_SLACK = 1.0 / 281474976710656
"""2^-48: what roundings and the cut may have moved a result by, relative to the sum of the sizes
of its two parts. Each suffers fewer than 25 roundings of 2^-53."""

_SUBNORMAL = 4.0 * LEAST
"""What they may have moved it by where z is subnormal: a half and a quarter of it, four times."""


def arctangent(x: float) -> "tuple[float, float]":
    """Bounds of ``atan x`` in rad, for any number and for both infinities."""
    size = abs(x)
    whole = 0.25 * TWO_PI_LO if size > 1.0 else 0.0
    z = 1.0 / size if size > 1.0 else size
    z = z / (1.0 + sqrt(1.0 + z * z))
    z = z / (1.0 + sqrt(1.0 + z * z))
    square = z * z
    total = 1.0 / 23
    for odd in (21, 19, 17, 15, 13, 11, 9, 7, 5, 3, 1):
        total = 1.0 / odd - total * square
    part = 4.0 * z * total
    slack = _SLACK * (part + whole) + _SUBNORMAL
    value = abs(whole - part)
    lo, hi = down(value - slack), up(value + slack)
    return (lo, hi) if x >= 0.0 else (-hi, -lo)
