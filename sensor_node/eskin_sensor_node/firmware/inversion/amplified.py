"""A quantity behind an amplifier."""

from eskin_sensor_node.firmware.inversion.codes import code_bounds
from eskin_sensor_node.firmware.rounding import down, up

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.inversion.codes import Adc, Bounds, Buffer, Codes


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
