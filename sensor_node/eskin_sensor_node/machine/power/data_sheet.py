"""The supply's data sheet as the firmware is given it: numbers by name, and nothing true."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.machine.power.idle import idle_power
from eskin_sensor_node.machine.power.pulse import pulse_energy

if TYPE_CHECKING:
    from eskin_sensor_node.machine.power.settings import EnergySection

_BILLION = 1_000_000_000


def energy_sheet(section: EnergySection) -> dict[str, float]:
    """All numbers of ``[energy]`` in SI units; bounds of the pulse in J, of an idle link in W."""
    pulse, idle = pulse_energy(section), idle_power(section)
    return {name: float(value) for name, value in section} | {
        "adc_min": 0.0,
        "horizon_ns": float(round(section.horizon_s * _BILLION)),
        "pulse_lo": float(pulse.inf),
        "pulse_hi": float(pulse.sup),
        "idle_lo": float(idle.inf),
        "idle_hi": float(idle.sup),
    }
