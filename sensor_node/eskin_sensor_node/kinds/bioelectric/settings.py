"""Settings of an electrode on the skin."""

from __future__ import annotations

from typing import ClassVar, Literal

from eskin_sensor_node.firmware.taxel.bioelectric import BioelectricTaxel
from eskin_sensor_node.kinds.settings import Positive, Rate, TaxelSection, Tolerance, unit
from eskin_sensor_node.world.scenario.fit import Played


class BioelectricSection(Played, TaxelSection):
    """Voltage that the body makes. Noise: in V, behind the amplifier, before the bipolar ADC.

    A biometric signal: it identifies a person.
    """

    firmware: ClassVar[type[BioelectricTaxel]] = BioelectricTaxel

    kind: Literal["bioelectric"]
    sampling: Rate = unit("sampling_Hz", 250.0)
    electrode_gain: Positive = unit("electrode_gain_V_per_V", 500.0)
    electrode_gain_tolerance: Tolerance = 1e-3
    input_offset: float = unit("input_offset_V", 1e-5, ge=0, description="greatest offset")
    adc_max: Positive = unit("adc_max_V", 1.25)
    bioelectric_prominence: Positive | None = unit("bioelectric_prominence_V", None)

    @property
    def adc_min(self) -> float:
        """Lower end of the range, in V: the converter is bipolar."""
        return -self.adc_max
