"""A capacitive polymer that measures the humidity."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from eskin_sensor_node.firmware.inversion.hygrometer import REFERENCE_HUMIDITY
from eskin_sensor_node.firmware.taxel.hygrometer import HygrometerTaxel
from eskin_sensor_node.kinds.frontend import Digitised
from eskin_sensor_node.kinds.kind import Kind
from eskin_sensor_node.kinds.parameters import draw_part
from eskin_sensor_node.kinds.rc import RcFrontend, RcSection
from eskin_sensor_node.kinds.settings import Positive, Rate, Tolerance, unit
from eskin_sensor_node.kinds.signals import Signals, World
from eskin_sensor_node.world.scenario import read_scenario
from eskin_sensor_node.world.scenario.fit import Played

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator


class HygrometerSection(Played, RcSection):
    """Polymer whose capacitance is linear in the humidity. Noise: in A, before the ADC."""

    firmware: ClassVar[type[HygrometerTaxel]] = HygrometerTaxel

    kind: Literal["hygrometer"]
    sampling: Rate = unit("sampling_Hz", 50.0)
    reference: Positive = unit("reference_Hz", 1e6)
    adc_min: float = unit("adc_min_A", 0.75e-3, ge=0)
    capacitance: Positive = unit("capacitance_F", 180e-12, description="at 50 %")
    capacitance_tolerance: Tolerance = 1e-3
    sensitivity: float = unit(
        "sensitivity_per_percent", 1.8e-3, gt=0, le=0.01, description="relative"
    )
    sensitivity_tolerance: Tolerance = 0.01
    error_percent: float = Field(
        default=2.0, ge=0, le=20, description="greatest deviation from the straight line"
    )
    humidity_prominence: Positive | None = unit("humidity_prominence_percent", None)


class HygrometerWorld(World):
    """Humidity of the air."""

    def __init__(self, taxel: HygrometerSection, random: ColumnGenerator) -> None:
        del random
        self._script = read_scenario(taxel.scenario)

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True humidity in %."""
        del random
        _, local = self._script.local(seconds)
        truth = {"humidity": self._script.ambient.humidity(local)}
        return Signals(truth, truth)


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


HYGROMETER = Kind(
    settings=HygrometerSection,
    world=HygrometerWorld,
    frontend=HygrometerFrontend,
    samples_per_code=4,  # air changes slowly
)
