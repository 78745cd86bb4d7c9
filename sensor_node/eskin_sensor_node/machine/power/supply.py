"""The true supercapacitor behind its converter, and what it gains and loses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin_sensor_node.kinds.converter import Converter
from eskin_sensor_node.kinds.parameters import draw_part
from eskin_sensor_node.machine.power.loads import Loads

if TYPE_CHECKING:
    from eskin_sensor_node.kinds.generator import ColumnGenerator
    from eskin_sensor_node.machine.work_counters import WorkCounters
    from eskin_sensor_node.settings import EnergySection

_BILLION: Final = 1_000_000_000
_LEAST_VOLTAGE: Final = 1e-3


@dataclass(slots=True)
class Flows:
    """True energies in J since a beginning.

    Attributes:
        harvested: Into the supercapacitor.
        spent: By the machine's work.
        leaked: Through the supercapacitor's leakage.
        burnt: In its series resistance.
        shunted: What it had no room for.
    """

    harvested: float = 0.0
    spent: float = 0.0
    leaked: float = 0.0
    burnt: float = 0.0
    shunted: float = 0.0


class Supply:
    """A supercapacitor that harvesters fill and the machine empties.

    Args:
        sheet: Its data sheet, and that of the loads.
        random: Draws the true parts.
    """

    def __init__(self, sheet: EnergySection, random: ColumnGenerator) -> None:
        def part(name: str) -> float:
            drawn = draw_part(random, getattr(sheet, name), getattr(sheet, f"{name}_tolerance"))
            return float(drawn.item())

        self._sheet = sheet
        self._capacitance = part("capacitance")
        self._series = part("series_resistance")
        self._leakage = part("leakage_resistance")
        self._current = part("active_current")
        self._converter = Converter(_SupplySheet(sheet), random)
        self._loads = Loads(sheet, random)
        self._most = 0.5 * self._capacitance * sheet.rated_voltage**2
        self.energy = 0.5 * self._capacitance * sheet.start_voltage**2
        """True stored energy in J."""
        self.flows = Flows()

    @property
    def voltage(self) -> float:
        """Open-circuit voltage of the supercapacitor in V."""
        return math.sqrt(2.0 * self.energy / self._capacitance)

    @property
    def failing(self) -> bool:
        """Whether the machine must stop."""
        return self.voltage < self._sheet.brown_out_voltage

    @property
    def restored(self) -> bool:
        """Whether a machine that stopped can start again."""
        return self.voltage >= self._sheet.restart_voltage

    def pass_span(self, work: WorkCounters, harvested: float) -> None:
        """Let the machine work while so many J come in; short spans, below a minute."""
        seconds, voltage = work.span / _BILLION, max(self.voltage, _LEAST_VOLTAGE)
        spent = sum(self._loads.costs(work))
        leaked = voltage**2 / self._leakage * seconds
        # The current of the mean power warms the series resistance.
        burnt = (spent / voltage) ** 2 * self._series / seconds if seconds > 0.0 else 0.0
        level = self.energy + harvested - spent - leaked - burnt
        self.energy = min(max(level, 0.0), self._most)
        flows = self.flows
        flows.harvested += harvested
        flows.spent += spent
        flows.leaked += leaked
        flows.burnt += burnt
        flows.shunted += max(level - self._most, 0.0)

    def rest(self, energy: float, seconds: float) -> None:
        """Hold what is left of so many J after some seconds in which nothing came and went."""
        left = math.exp(-2.0 * seconds / (self._leakage * self._capacitance))
        self.energy = min(energy, self._most) * left

    def code(self) -> int:
        """The converter's code of its voltage under the current that measuring draws."""
        terminal = self.voltage - self._series * self._current
        return int(self._converter.convert(np.array([terminal])).item())


class _SupplySheet:
    """The supply's converter, as `Converter` reads it."""

    def __init__(self, sheet: EnergySection) -> None:
        self.adc_bits, self.adc_min, self.adc_max = sheet.adc_bits, 0.0, sheet.adc_max
        self.adc_gain_error, self.adc_offset_error = sheet.adc_gain_error, sheet.adc_offset_error
        self.adc_nonlinearity = sheet.adc_nonlinearity
        # Neither an amplifier nor a trimmer stands before it.
        self.gain_tolerance = self.trimmer_step = self.trimmer_tolerance = 0.0
        self.trimmer_steps = 0
