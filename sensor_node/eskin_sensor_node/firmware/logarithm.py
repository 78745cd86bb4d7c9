"""An enclosure of the natural logarithm from the four operations alone.

No port's own logarithm will do: they differ in the last digit. With ``x = m·2^k``, m in
[3/4, 3/2], and ``z = (m - 1)/(m + 1)``, at most 1/5 in size::

    ln x = k·ln 2 + 2·(z + z³/3 + z⁵/5 + …)

The series is cut after z²³/23; what is left out is below ``2·z²⁵/25/(1 - z²) < 2^-60·|z|``.
"""

from eskin_sensor_node.firmware.rounding import INFINITY, MOST, down, up

_LN2 = 6243314768165359 / 9007199254740992
"""Below ln 2, by less than its last digit."""
_SLACK = 1.0 / 281474976710656
"""2^-48: what roundings and the cut may have moved a result by, relative to the sum of the sizes
of its two parts. Each part suffers fewer than 20 roundings of 2^-53, and LN2 one."""


def logarithm(x: float) -> "tuple[float, float]":
    """Bounds of ``ln x`` for ``x >= 0``; of zero and of infinity, both are infinite."""
    if x <= 0.0:
        return -INFINITY, -INFINITY
    if x > MOST:
        return INFINITY, INFINITY
    k = 0
    while x < 0.75:
        x *= 2.0
        k -= 1
    while x > 1.5:
        x *= 0.5
        k += 1
    z = (x - 1.0) / (x + 1.0)
    square = z * z
    total = 1.0 / 23
    for odd in (21, 19, 17, 15, 13, 11, 9, 7, 5, 3, 1):
        total = total * square + 1.0 / odd
    part, whole = 2.0 * z * total, k * _LN2
    slack = _SLACK * (abs(part) + abs(whole))
    return down(part + whole - slack), up(part + whole + slack)
