"""A coil of a skin, which sees metal in two ways."""

from eskin_sensor_node.firmware.calibration import converter, empty_coil
from eskin_sensor_node.firmware.taxel.inductive import InductiveTaxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.calibration import Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes


class CoilTaxel(InductiveTaxel):
    """Metal by the oscillator's frequency, and by its eddy currents' amplitude and phase."""

    quantities = (
        ("frequency", "Hz"),
        ("inductance", "H"),
        ("distance", "m"),
        ("eddy_amplitude", "1"),
        ("eddy_phase", "rad"),
    )
    inputs = ("voltage", "in_phase", "quadrature")

    def _calibrate(self, sheet: "Sheet") -> None:
        super()._calibrate(sheet)
        own = dict(sheet)
        own["adc_min"], own["adc_max"] = 0.0, sheet["demodulator_max"]
        self._demodulator = converter(own)
        self._empty = empty_coil(sheet)

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Frequency in Hz, inductance in H, distance in m; amplitude, and phase in rad."""
        super().measure(codes[:1], n, bounds[:6])
        self._functions.measure_eddy(
            codes[1],
            codes[2],
            n,
            self._last,
            self._demodulator,
            self._reach,
            *self._empty,
            *bounds[6:],
        )
