"""What the control unit knows of each kind of taxel: inputs, quantities, calibration."""

from eskin_sensor_node.firmware.taxel.bioelectric import BioelectricTaxel
from eskin_sensor_node.firmware.taxel.capacitive import CapacitiveTaxel
from eskin_sensor_node.firmware.taxel.coil import CoilTaxel
from eskin_sensor_node.firmware.taxel.hybrid import HybridTaxel
from eskin_sensor_node.firmware.taxel.hygrometer import HygrometerTaxel
from eskin_sensor_node.firmware.taxel.inductive import InductiveTaxel
from eskin_sensor_node.firmware.taxel.pad import PadTaxel
from eskin_sensor_node.firmware.taxel.taxel import Taxel
from eskin_sensor_node.firmware.taxel.thermometer import ThermometerTaxel
from eskin_sensor_node.firmware.taxel.touch import TouchTaxel

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["CHAINS", "Taxel"]

CHAINS: "Mapping[str, type[Taxel]]" = {
    "capacitive": CapacitiveTaxel,
    "touch": TouchTaxel,
    "inductive": InductiveTaxel,
    "hybrid": HybridTaxel,
    "pad": PadTaxel,
    "coil": CoilTaxel,
    "thermometer": ThermometerTaxel,
    "hygrometer": HygrometerTaxel,
    "bioelectric": BioelectricTaxel,
}
"""Class of each chain."""
