"""What one conversion costs the sensor: the MOSFET's pulse into MagFES and EcFES (Fig. 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin.interval import Interval
from eskin.models import energy_flow

if TYPE_CHECKING:
    from eskin_sensor_node.machine.power.settings import EnergySection


def pulse_energy(sheet: EnergySection) -> Interval:
    """Energy in J that one pulse takes from the supercapacitor.

    With a coil it is ``E_in`` of `eskin.models.energy_flow`. Without one EcFES alone is filled:
    in the end it takes ``C·V²``, of which it stores the half that the paper counts.
    """
    around, voltage = Interval.relative, _voltage(sheet)
    if sheet.coil_inductance == 0.0:
        return around(sheet.sensor_capacitance, sheet.sensor_tolerance) * voltage * voltage
    flow = energy_flow(
        sheet.pulse_s,
        voltage=voltage,
        switch_resistance=around(sheet.switch_resistance, sheet.sensor_tolerance),
        coil_resistance=around(sheet.coil_resistance, sheet.sensor_tolerance),
        inductance=around(sheet.coil_inductance, sheet.sensor_tolerance),
        capacitor_resistance=around(sheet.sensor_resistance, sheet.sensor_tolerance),
        capacitance=around(sheet.sensor_capacitance, sheet.sensor_tolerance),
    )
    return flow.supplied


def stored_energy(sheet: EnergySection) -> Interval:
    """``½·C·V²`` in J that EcFES holds after a pulse: what the paper counts for a taxel."""
    voltage = _voltage(sheet)
    capacitance = Interval.relative(sheet.sensor_capacitance, sheet.sensor_tolerance)
    return 0.5 * capacitance * voltage * voltage


def _voltage(sheet: EnergySection) -> Interval:
    return Interval.relative(sheet.sensor_voltage, sheet.sensor_voltage_tolerance)
