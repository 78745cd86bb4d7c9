"""From ADC codes back to quantities: each result encloses the truth.

Known are the parts' tolerances, the converter's errors, and the noise's reach. A saturated code
leaves the side open that it does not bound, on every quantity that follows from it.

Each ``measure_…`` fills buffers sample by sample, as an interrupt's buffer is worked off.
Calibrations are tuples of floats that `eskin_sensor_node.firmware.calibration` makes.
"""

from eskin_sensor_node.firmware.inversion.capacitive import measure_capacitive
from eskin_sensor_node.firmware.inversion.codes import measure_amplified
from eskin_sensor_node.firmware.inversion.coil import measure_eddy
from eskin_sensor_node.firmware.inversion.hygrometer import measure_humidity
from eskin_sensor_node.firmware.inversion.inductive import measure_inductive
from eskin_sensor_node.firmware.inversion.pad import (
    measure_felt,
    measure_humidity_change,
    measure_neighbour,
    measure_permittivity,
    measure_pressure,
    measure_thermal_change,
    measure_unknown,
)
from eskin_sensor_node.firmware.inversion.thermometer import measure_temperature
from eskin_sensor_node.firmware.inversion.touch import measure_touch

TYPE_CHECKING = False
if TYPE_CHECKING:
    from eskin_sensor_node.firmware.inversion.codes import Buffer as Buffer
    from eskin_sensor_node.firmware.inversion.codes import Codes as Codes

__all__ = [
    "measure_amplified",
    "measure_capacitive",
    "measure_eddy",
    "measure_felt",
    "measure_humidity",
    "measure_humidity_change",
    "measure_inductive",
    "measure_neighbour",
    "measure_permittivity",
    "measure_pressure",
    "measure_temperature",
    "measure_thermal_change",
    "measure_touch",
    "measure_unknown",
]
