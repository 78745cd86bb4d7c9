"""The ICM hybrid after switching on (eq. 26 and 27 of the paper, in its reduced form).

With ``θ = ωt + ψ``, ``x = ωτ`` and ``h = [sin θ - x cos θ - (sin ψ - x cos ψ)·e^(-t/τ)]/(1 + x²)``:
``i1 = Vm/R1 · h`` with ``τ = L/R1``, and ``u_c = Vm · h`` with ``τ = R2·C``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.kinds.parameters import draw_part
from eskin_sensor_node.kinds.signals import Signals, World

if TYPE_CHECKING:
    from eskin.interval import Floats
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.kinds.hybrid.settings import HybridSection


class HybridWorld(World):
    """MagFES current and EcFES voltage, both zero at the trigger."""

    def __init__(self, taxel: HybridSection, random: ColumnGenerator) -> None:
        def part(value: float) -> Floats:
            return draw_part(random, value, taxel.part_tolerance)

        self._amplitude = part(taxel.amplitude)
        self._coil_resistance = part(taxel.coil_resistance_ohm)
        self._coil_time = part(taxel.coil_inductance) / self._coil_resistance
        self._capacitor_time = part(taxel.capacitor_resistance_ohm) * part(taxel.capacitance)
        self._omega = 2.0 * math.pi * taxel.supply
        self._phase = math.radians(taxel.phase_deg)

    def signals(self, seconds: Floats, random: ColumnGenerator) -> Signals:
        """True current in A and voltage in V, at times since the trigger."""
        del random
        most = self._amplitude / self._coil_resistance
        truth = {
            "current": most * self._response(seconds, self._coil_time),
            "voltage": self._amplitude * self._response(seconds, self._capacitor_time),
        }
        return Signals(truth, truth)

    def _response(self, seconds: Floats, tau: Floats) -> Floats:
        x, angle = self._omega * tau, self._omega * seconds + self._phase
        start = math.sin(self._phase) - x * math.cos(self._phase)
        response = np.sin(angle) - x * np.cos(angle) - start * np.exp(-seconds / tau)
        return np.asarray(response / (1.0 + x * x))
