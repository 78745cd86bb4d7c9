"""A budget of energy: what comes in, what goes out, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from eskin.interval import Interval, Verdict
from eskin_sensor_node.firmware.energy import thrice
from eskin_sensor_node.machine.power.data_sheet import stored_energy
from eskin_sensor_node.machine.power.harvest import Harvester, Touches, harvest_bounds
from eskin_sensor_node.machine.power.loads import bounds
from eskin_sensor_node.machine.work_counters import WorkCounters
from eskin_sensor_node.tools.budget.run import work_of

if TYPE_CHECKING:
    from eskin_sensor_node.settings import EnergySection, NodeSettings
    from eskin_sensor_node.tools.budget.design import NodeDesign
    from eskin_sensor_node.tools.budget.run import Progress


@dataclass(frozen=True, slots=True)
class Budget:
    """What a design does in one mode, over some seconds.

    Attributes:
        design: Whose.
        mode: In which mode.
        seconds: How long.
        work: What the node did.
        touches: What touched it.
    """

    design: NodeDesign
    mode: str
    seconds: int
    work: WorkCounters
    touches: Touches

    @classmethod
    def measure(cls, design: NodeDesign, mode: str, seconds: int, progress: Progress) -> Self:
        """Run the firmware; ``progress`` takes the emulated seconds that passed."""
        work = work_of(design.settings, mode, seconds, progress)
        touches = Harvester(design.settings.taxel).touches(float(seconds))
        return cls(design, mode, seconds, work, touches)

    @property
    def spent(self) -> dict[str, Interval]:
        """Mean power in W, by part."""
        section = self.design.settings.energy
        parts = _energies(section, self.work)
        parts["leakage"] = _leakage(section) * self.seconds
        return self._powers(parts)

    @property
    def consumption(self) -> Interval:
        """Mean power in W that the node takes from its supercapacitor."""
        return _sum(self.spent)

    @property
    def harvest(self) -> dict[str, Interval]:
        """Mean power in W that touches give."""
        return self._powers(harvest_bounds(self.design.settings.energy, self.touches))

    @property
    def filled(self) -> Interval:
        """Mean power in W that the sensors' capacitors hold after being filled: the paper's."""
        each = stored_energy(self.design.settings.energy) * self.work.conversions
        return self._powers({"filled": each})["filled"]

    @property
    def verdict(self) -> Verdict:
        """Whether touches give at least what is spent."""
        net = _sum(self.harvest) - self.consumption
        return Verdict(thrice(float(net.inf), float(net.sup)))

    def _powers(self, energies: dict[str, Interval]) -> dict[str, Interval]:
        return {name: energy / self.seconds for name, energy in energies.items()}


def saving(full: Budget, frugal: Budget) -> tuple[Interval, Interval]:
    """What a frugal mode saves: mean power in W, and its share of the full mode's consumption.

    Both modes pay the same true prices, so the saving is that of the difference of their work, not
    the difference of two independent intervals.
    """
    less = WorkCounters(*(one - other for one, other in zip(full.work, frugal.work, strict=True)))
    # The same work takes the same cycles, whichever these are: what is saved is the difference.
    less = less._replace(fewest=min(less.fewest, less.cycles), cycles=max(less.fewest, less.cycles))
    less = less._replace(asleep=min(less.asleep, less.on), on=max(less.asleep, less.on))
    saved = _sum(_energies(full.design.settings.energy, less)) / full.seconds
    rest = frugal.consumption
    low = Interval(saved.inf) / (Interval(saved.inf) + Interval(rest.sup))
    high = Interval(saved.sup) / (Interval(saved.sup) + Interval(rest.inf))
    return saved, Interval(low.inf, high.sup)


def _energies(section: EnergySection, work: WorkCounters) -> dict[str, Interval]:
    """Energies of some work in J by part, with packets that are sent again as often as may be."""
    parts = bounds(section, work)
    loss = Interval(section.packet_loss)
    parts["retransmission"] = parts["radio"] * Interval(0.0, (loss / (1.0 - loss)).sup)
    return parts


def _leakage(section: EnergySection) -> Interval:
    """Power in W that leaks between the brown-out voltage and the rated one."""
    voltage = Interval(section.brown_out_voltage, section.rated_voltage)
    resistance = Interval.relative(section.leakage_resistance, section.leakage_resistance_tolerance)
    return voltage * voltage / resistance


def _sum(parts: dict[str, Interval]) -> Interval:
    total = Interval(0.0)
    for each in parts.values():
        total = total + each
    return total


def conditions(settings: NodeSettings) -> list[str]:
    """Conditions of the verdict, which no data sheet states, with their settings."""
    energy, often = settings.energy, f"{settings.energy.connection_interval_s:g} s"
    link = f"a Bluetooth connection has an event every {often} (connection_interval_s)"
    if settings.skin.present:
        link = "the node is wired, its machine is never asleep, and it sends each sample"
    return [
        "every part lies inside the tolerances of [energy]",
        f"at most {energy.packet_loss:.0%} of all packets are lost and sent again (packet_loss)",
        link,
        f"there are at most {energy.handshakes_a_day:g} TLS handshakes a day (handshakes_a_day)",
        "flash is written once a message, erased as often as written, and powered down between",
        "the firmware is compiled, and takes the cycles that docs/node.md counts and assumes",
        "touches come as in the scenario that was run",
    ]
