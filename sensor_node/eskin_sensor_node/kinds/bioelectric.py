"""An electrode on the skin."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from eskin_sensor_node.firmware.taxel.bioelectric import BioelectricTaxel
from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.frontend import Frontend
from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.parameters import draw_noise, draw_part
from eskin_sensor_node.kinds.settings import Positive, Rate, TaxelSection, Tolerance, unit
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import read_scenario
from eskin_sensor_node.world.scenario.fit import Played

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.frontend import Digitised
    from eskin_sensor_node.kinds.generator import ColumnGenerator


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


class BioelectricWorld(World):
    """Voltage under an electrode."""

    def __init__(self, taxel: BioelectricSection, random: ColumnGenerator) -> None:
        del random
        self._bioelectric = read_scenario(taxel.scenario).bioelectric

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True voltage in V."""
        del random
        truth = {"bioelectric": self._bioelectric.voltage(seconds)}
        return Signals(truth, truth)


class BioelectricFrontend(Frontend):
    """Voltage of the skin → amplifier with an offset → bipolar ADC."""

    def __init__(self, taxel: BioelectricSection, random: ColumnGenerator) -> None:
        self._gain = draw_part(random, taxel.electrode_gain, taxel.electrode_gain_tolerance)
        self._offset = taxel.input_offset * random.uniform(-1.0, 1.0)
        self._converter = Converter(taxel, random)
        self._noise = taxel.noise

    def digitise(self, sensed: Mapping[str, Floats], random: ColumnGenerator) -> Digitised:
        """Codes of the amplifier's voltage."""
        voltage = self._gain * (sensed["bioelectric"] + self._offset)
        noisy = voltage + draw_noise(random, self._noise)
        return self._digitised({}, {"voltage": noisy})


BIOELECTRIC = Kind(
    settings=BioelectricSection, world=BioelectricWorld, frontend=BioelectricFrontend
)
