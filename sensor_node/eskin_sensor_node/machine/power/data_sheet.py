"""The supply's data sheet: numbers for the firmware, power of an idle node, energy of a pulse."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin.interval import Interval
from eskin.models import energy_flow
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from eskin_sensor_node.settings import EnergySection

_DAY_S: Final = 86_400


def energy_sheet(section: EnergySection) -> dict[str, float]:
    """All numbers of ``[energy]`` in SI units; bounds of the pulse in J, of an idle link in W."""
    pulse, idle = pulse_energy(section), idle_power(section)
    return {name: float(value) for name, value in section} | {
        "adc_min": 0.0,
        "horizon_ns": float(round(section.horizon_s * BILLION)),
        "pulse_lo": float(pulse.inf),
        "pulse_hi": float(pulse.sup),
        "idle_lo": float(idle.inf),
        "idle_hi": float(idle.sup),
    }


def idle_power(sheet: EnergySection) -> Interval:
    """Power in W of listening, handshakes and flash, as long as the machine has power.

    A connection event with data is counted like one without; there may be no handshake in a day.
    """
    event = Interval.relative(sheet.listening, sheet.listening_tolerance)
    handshake = Interval.relative(sheet.handshake, sheet.handshake_tolerance)
    often = Interval(0.0, sheet.handshakes_a_day)
    resting = Interval.relative(sheet.flash_resting, sheet.flash_resting_tolerance)
    return event / sheet.connection_interval_s + handshake * often / _DAY_S + resting


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
