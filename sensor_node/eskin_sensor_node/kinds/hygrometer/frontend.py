"""The chain of a hygrometer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.firmware.inversion.hygrometer import REFERENCE_HUMIDITY
from eskin_sensor_node.kinds.frontend import Digitised
from eskin_sensor_node.kinds.parameters import draw_part
from eskin_sensor_node.kinds.rc import RcFrontend

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.hygrometer.settings import HygrometerSection


class HygrometerFrontend(RcFrontend):
    """Humidity → polymer's capacitance → the chain of Fig. 3."""

    def __init__(self, taxel: HygrometerSection, random: ColumnGenerator) -> None:
        super().__init__(taxel, random)
        self._rest = draw_part(random, taxel.capacitance, taxel.capacitance_tolerance)
        self._sensitivity = draw_part(random, taxel.sensitivity, taxel.sensitivity_tolerance)
        self._off = taxel.error_percent * random.uniform(-1.0, 1.0)

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of the current."""
        above = sensed["humidity"] + self._off - REFERENCE_HUMIDITY
        capacitance = self._rest * (1.0 + self._sensitivity * above)
        made = super().digitise({"capacitance": capacitance}, random)
        return Digitised({}, made.codes, made.held)
