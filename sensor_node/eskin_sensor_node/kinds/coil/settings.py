"""Settings of a coil of a skin."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from eskin_sensor_node.firmware.taxel.coil import CoilTaxel
from eskin_sensor_node.kinds.lc import LcSection
from eskin_sensor_node.kinds.settings import Positive, Tolerance, unit
from eskin_sensor_node.world.scenario.fit import Staged


class CoilSection(Staged, LcSection):
    """Coil in a skin that sees metal as a scenario has it. Noise: in V, before each ADC."""

    firmware: ClassVar[type[CoilTaxel]] = CoilTaxel
    disturbances: ClassVar[int] = 2

    kind: Literal["coil"]
    coil_resistance_ohm: Positive = Field(default=5.0, description="its loss resistance")
    coil_resistance_tolerance: Tolerance = 5e-3
    excitation: Positive = unit(
        "excitation_Hz", 1000.0, description="frequency at which eddy currents are seen"
    )
    excitation_tolerance: Tolerance = 1e-5
    drive: Positive = unit("drive_V", 1.0, description="amplitude of the excitation")
    drive_tolerance: Tolerance = 1e-3
    demodulator_gain: Positive = unit("demodulator_gain_V_per_A", 30.0)
    demodulator_gain_tolerance: Tolerance = 1e-3
    demodulator_max: Positive = unit(
        "demodulator_max_V", 1.25, description="upper end of its converters' range, from 0 V"
    )
    eddy_amplitude_prominence: Positive | None = None
    eddy_phase_prominence: Positive | None = unit("eddy_phase_prominence_rad", None)
