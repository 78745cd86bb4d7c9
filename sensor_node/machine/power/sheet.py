"""The supply's data sheet as the firmware is given it: numbers by name, and nothing true."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sensor_node.machine.power.pulse import pulse_energy

if TYPE_CHECKING:
    from sensor_node.machine.power.section import EnergySection

_BILLION = 1_000_000_000


def energy_sheet(section: EnergySection) -> dict[str, float]:
    """All numbers of ``[energy]`` in SI units, and bounds of the sensor's pulse in J."""
    pulse = pulse_energy(section)
    return {name: float(value) for name, value in section} | {
        "adc_min": 0.0,
        "horizon_ns": float(round(section.horizon_s * _BILLION)),
        "pulse_lo": float(pulse.inf),
        "pulse_hi": float(pulse.sup),
    }
