"""A member that samples alone, because of its settings or its design."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_sensor_node.firmware import states
from eskin_sensor_node.fleet.cohort import CohortPart, Key
from eskin_sensor_node.fleet.columns import fresh
from eskin_sensor_node.fleet.setting import longest_region, setting_of
from eskin_sensor_node.fleet.taxel import TaxelState
from eskin_sensor_node.kinds.neighbours import neighbours
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.node.node import Node
from eskin_sensor_node.node.self_test import NodeSelfTest
from eskin_sensor_node.world.replay.settings import Recorded

if TYPE_CHECKING:
    from eskin_sensor_node.firmware.outbox import Outbox
    from eskin_sensor_node.fleet.cohort import Cohort
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.machine.clock import Clock
    from eskin_sensor_node.node.ground_truth import GroundTruth
    from eskin_sensor_node.node.taxel import EmulatedTaxel
    from eskin_sensor_node.settings import NodeSettings


class SingleNode(Node):
    """A single node, but for its storage and its connection.

    Args:
        settings: The fleet's.
        name: The member's.
        clock: Its clock, as that of its cohort.
        outbox: Its outbox.
        truth: The fleet's.
        seed: Its own.
    """

    def __init__(
        self,
        settings: NodeSettings,
        name: str,
        *,
        clock: Clock,
        outbox: Outbox,
        truth: GroundTruth,
        seed: int,
    ) -> None:
        own = settings.model_copy(
            update={"node": settings.node.model_copy(update={"name": name, "seed": seed})}
        )
        super().__init__(
            own,
            clock=clock,
            outbox=outbox,
            truth=truth,
            seed=seed,
            functions=compiled_inversion(),
        )

    @property
    def running(self) -> bool:
        """Whether its firmware runs; else nothing is sent or taken."""
        return self.machine.running

    def take_over(self, cohort: Cohort, number: int) -> None:
        """Continue from the state of a node of a cohort."""
        row = cohort.row(number)
        for taxel, rows in zip(self.taxels, cohort.taxels, strict=True):
            setting, unit = rows.setting, taxel.control_unit
            if setting.gain != unit.adaptation.gain:
                taxel.amplify(setting.gain)
            unit.mode, unit.smoothing = setting.mode, setting.smoothing
            unit.schedule, taxel.next = setting.schedule, rows.next
            for k, (channel, threshold) in enumerate(
                zip(unit.units, setting.thresholds, strict=True)
            ):
                channel.restart(unit.schedule, threshold, setting.smoothing)
                rows.columns.load(k, row, channel, rows.next.first)
        since = min(taxel.next.start for taxel in self.taxels)
        self._self_test = NodeSelfTest(
            self._settings.taxel,
            self.taxels,
            self._clock.known,
            self._outbox.message_writer,
            since=since,
        )
        self.reflexes.skip(self._clock.ticks())
        for taxel_number in cohort.key.order:
            self.sampling.arm(taxel_number, self.taxels[taxel_number].next)

    def mark_dead(self, taxel: int) -> None:
        """Take over that a taxel is certainly dead, and was reported as such."""
        self._self_test.mark_dead(self.taxels[taxel])

    @property
    def key(self) -> Key | None:
        """What a cohort that it can join has in common; ``None``: it must sample alone.

        What follows its own measurements cannot join: monitors, adaptive control, and the reports
        of a broken taxel. Nor has it a clock of its own after a reset.
        """
        if self.reflexes.definitions:
            return None
        units = [taxel.control_unit for taxel in self.taxels]
        if self.machine.booted or self.machine.starting or self.states.state != states.SLEEP:
            return None
        if any(unit.adaptive or unit.broken or unit.omitted_samples for unit in units):
            return None
        if self._assembler.begin is not None:
            return None
        found = [setting_of(taxel.control_unit, taxel.next)[0] for taxel in self.taxels]
        return Key(tuple(found), tuple(self.sampling.order))

    def share(self, number: int) -> CohortPart:
        """Its state, in a column of one."""
        each = zip(self.taxels, self._settings.taxel, strict=True)
        return CohortPart([number], [_standing(taxel, design) for taxel, design in each])

    @property
    def due(self) -> bool:
        """Whether something is to be done by now."""
        return self.machine.starting or self.next_due <= self._clock.now()

    def catch_up(self) -> None:
        """Run what is due by now."""
        self.advance(self._clock.now())

    def enclosure(self) -> tuple[int, int]:
        """Earliest and latest UTC of the present, as it knows it."""
        return self._clock.known.enclosure(max(0, self._clock.ticks()))


def _standing(taxel: EmulatedTaxel, design: TaxelSection) -> TaxelState:
    unit = taxel.control_unit
    setting, before = setting_of(unit, taxel.next)
    columns = fresh(len(unit.units), 1, longest_region(design, unit.schedule.dt))
    for k, channel in enumerate(unit.units):
        columns.store(k, 0, channel, before)
    return TaxelState(setting, columns)


def reason_to_sample_alone(settings: NodeSettings) -> str | None:
    """What in a design cannot be calculated in columns; ``None`` where all can.

    Energy, monitors, adaptive control and the comparison of neighbours follow what each node
    measures; a recording has gaps of its own.
    """
    if settings.monitor:
        return "monitor"
    if settings.energy.on:
        return "energy"
    for taxel in settings.taxel:
        if taxel.adaptive:
            return f"taxel.{taxel.id}.adaptive"
        if isinstance(taxel, Recorded):
            return f"taxel.{taxel.id}.kind"
    if any(neighbours(settings.taxel)):
        return "taxel.scenario"
    return None
