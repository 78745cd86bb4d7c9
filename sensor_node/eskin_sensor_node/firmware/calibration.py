"""The parts of a data sheet, as bounds to calculate with.

A part of value v and tolerance t lies in ``v·[1 - t, 1 + t]``; a sheet is a map of SI values.
"""

from eskin_sensor_node.firmware.rounding import TWO_PI_HI, TWO_PI_LO, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping

    Bounds = tuple[float, float]
    Sheet = Mapping[str, float]

EPSILON_0 = (
    down(88541878048 / 10000000000000000000000),
    up(88541878328 / 10000000000000000000000),
)
"""Permittivity of vacuum in F/m: CODATA 2022, with ten times its standard uncertainty."""
_EMULATION = 1.0 / 281474976710656
"""2^-48: a real chain does not round, an emulated one does, by a few digits of binary64. As a part
of the greater end of the converter's range."""


def part(sheet: "Sheet", name: str) -> "Bounds":
    """A positive part with its tolerance."""
    value, tolerance = sheet[name], sheet[name + "_tolerance"]
    if tolerance == 0.0:
        return value, value
    return down(value * down(1.0 - tolerance)), up(value * up(1.0 + tolerance))


def signed_part(sheet: "Sheet", name: str) -> "Bounds":
    """A part of either sign with its tolerance, which never takes it across zero."""
    value, tolerance = sheet[name], sheet[name + "_tolerance"]
    if tolerance == 0.0 or value == 0.0:
        return value, value
    near, far = value * down(1.0 - tolerance), value * up(1.0 + tolerance)
    if value > 0.0:
        return max(down(near), 0.0), up(far)
    return down(far), min(up(near), 0.0)


def product(a: "Bounds", b: "Bounds") -> "Bounds":
    """A product of positive bounds."""
    return down(a[0] * b[0]), up(a[1] * b[1])


def quotient(a: "Bounds", b: "Bounds") -> "Bounds":
    """A quotient of positive bounds."""
    return down(a[0] / b[1]), up(a[1] / b[0])


def converter(sheet: "Sheet") -> "tuple[float, float, float, float, float]":
    """Step and offset of the ADC with their errors, and its nonlinearity in steps.

    Code c stands for inputs of ``(c + [-inl, 1 + inl])·step + offset``.
    """
    lowest, highest = sheet["adc_min"], sheet["adc_max"]
    codes, gain = 1 << int(sheet["adc_bits"]), sheet["adc_gain_error"]
    step_lo, step_hi = down(highest - lowest) / codes, up(highest - lowest) / codes
    slack = up(_EMULATION * max(abs(lowest), abs(highest)))
    slack = up(slack + up(sheet["adc_offset_error"] * step_hi))
    return (
        down(step_lo * down(1.0 - gain)),
        up(step_hi * up(1.0 + gain)),
        down(lowest - slack),
        up(lowest + slack),
        sheet["adc_nonlinearity"],
    )


def oscillator(sheet: "Sheet") -> "Bounds":
    """``Gm / (2π·R·f_ref)``: a capacitance times the current that it makes (eq. 6)."""
    below = product(
        (TWO_PI_LO, TWO_PI_HI), product(part(sheet, "resistance"), part(sheet, "reference"))
    )
    return quotient(part(sheet, "transconductance"), below)


def trimmer(sheet: "Sheet", steps: int) -> "Bounds":
    """What the trimmer takes away at one of its steps, in the converter's unit."""
    size = abs(steps) * sheet["trimmer_step"] * (sheet["adc_max"] - sheet["adc_min"])
    slack = up(sheet["trimmer_tolerance"] + _EMULATION)
    lo, hi = down(size * down(1.0 - slack)), up(size * up(1.0 + slack))
    if steps == 0:
        return 0.0, 0.0
    return (lo, hi) if steps > 0 else (-hi, -lo)


def adjusted(
    adc: "tuple[float, float, float, float, float]", gain: "Bounds", trim: "Bounds"
) -> "tuple[float, float, float, float, float]":
    """A converter's calibration in terms of what is before amplifier and trimmer."""
    lo, hi = adc[2], adc[3]
    if trim != (0.0, 0.0):
        lo, hi = down(lo + trim[0]), up(hi + trim[1])
    return (
        down(adc[0] / gain[1]),
        up(adc[1] / gain[0]),
        down(lo / (gain[1] if lo >= 0.0 else gain[0])),
        up(hi / (gain[0] if hi >= 0.0 else gain[1])),
        adc[4],
    )


def distance(sheet: "Sheet", steps: int) -> "Bounds":
    """Distance of the plates at rest in m, with their actuator at one of its steps."""
    lo, hi = part(sheet, "plate_distance")
    if steps > 0:
        step = part(sheet, "actuator_step")
        lo, hi = down(lo + down(steps * step[0])), up(hi + up(steps * step[1]))
    return lo, hi
