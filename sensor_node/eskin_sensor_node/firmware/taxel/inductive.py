"""Taxels that see metal by a coil."""

from eskin_sensor_node.firmware.calibration import part
from eskin_sensor_node.firmware.taxel.taxel import Taxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.calibration import Sheet
    from eskin_sensor_node.firmware.inversion import Buffer, Codes


class InductiveTaxel(Taxel):
    """Frequency, inductance, and distance of a metal object."""

    quantities: "tuple[tuple[str, str], ...]" = (
        ("frequency", "Hz"),
        ("inductance", "H"),
        ("distance", "m"),
    )
    inputs: "tuple[str, ...]" = ("voltage",)
    monotone: "tuple[str, ...]" = ("frequency", "inductance", "distance")
    derived = ("distance",)

    def _calibrate(self, sheet: "Sheet") -> None:
        self._reference = part(sheet, "reference")
        self._capacitance = part(sheet, "capacitance")
        self._coil = (
            part(sheet, "inductance"),
            part(sheet, "inductance_change"),
            part(sheet, "damping"),
        )

    def measure(self, codes: "Sequence[Codes]", n: int, bounds: "Sequence[Buffer]") -> None:
        """Frequency in Hz, inductance in H, distance in m."""
        self._functions.measure_inductive(
            codes[0],
            n,
            self.last,
            self._adc,
            self._reach,
            self._reference,
            self._capacitance,
            self._coil,
            *bounds,
        )
