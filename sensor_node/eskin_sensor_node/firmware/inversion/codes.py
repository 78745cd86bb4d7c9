"""From ADC codes to the inputs of the converter."""

from eskin_sensor_node.firmware.rounding import INFINITY, down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import MutableSequence, Sequence

    Adc = tuple[float, float, float, float, float]
    Bounds = tuple[float, float]
    Buffer = MutableSequence[float]
    Codes = Sequence[int]


def code_bounds(code: int, last: int, adc: "Adc", reach: float) -> "Bounds":
    """What the input may have been: ``(code + [-inl, 1 + inl])·step + offset``, and noise."""
    step_lo, step_hi, offset_lo, offset_hi, nonlinearity = adc
    low, high = down(code - nonlinearity), up(code + 1 + nonlinearity)
    lo = down(low * (step_lo if low >= 0.0 else step_hi))
    hi = up(high * (step_hi if high >= 0.0 else step_lo))
    return (
        -INFINITY if code <= 0 else down(down(lo + offset_lo) - reach),
        INFINITY if code >= last else up(up(hi + offset_hi) + reach),
    )


def scaled(lo: float, hi: float, factor: "Bounds") -> "Bounds":
    """A product with a positive factor."""
    return (
        down(lo * (factor[0] if lo >= 0.0 else factor[1])),
        up(hi * (factor[1] if hi >= 0.0 else factor[0])),
    )


def measure_amplified(
    codes: "Codes",
    n: int,
    last: int,
    adc: "Adc",
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
