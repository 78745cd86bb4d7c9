"""The node's self-test: which taxels are broken, certainly or possibly."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from eskin_sensor_node.firmware.gap_reasons import DEAD, STUCK
from eskin_sensor_node.firmware.selftest import CERTAIN, IMPOSSIBLE, SelfTest
from eskin_sensor_node.kinds.neighbours import neighbours
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.firmware.clock import Clock
    from eskin_sensor_node.firmware.message_writer import MessageWriter, Record
    from eskin_sensor_node.kinds.settings import TaxelSection
    from eskin_sensor_node.node.taxel import EmulatedTaxel

SELF_TEST_WINDOW: Final = 20 * BILLION
"""Ticks of a window in which stuck and dead taxels are looked for."""

_DEAD_FAULT: Final = 0
"""Place of a dead taxel's verdict in what the self-test finds, before that of a stuck one."""


class NodeSelfTest:
    """Feeds the firmware's self-test with each frame, and reports what is broken.

    A taxel that is certainly broken reports no derived quantity until a window shows that it is
    not broken; one gap a window counts the samples that are left out.

    Args:
        designs: The settings of the node's taxels.
        taxels: The same, emulated.
        clock: What the node knows of time.
        message_writer: Writes its messages.
        since: Ticks at which the first window begins.

    Attributes:
        faults: Taxels that may be broken, by the last window: name, whether it is dead, whether it
            is stuck; none known before the first window is over.
    """

    def __init__(
        self,
        designs: Sequence[TaxelSection],
        taxels: Sequence[EmulatedTaxel],
        clock: Clock,
        message_writer: MessageWriter,
        *,
        since: int = 0,
    ) -> None:
        self._taxels = taxels
        self._clock = clock
        self._message_writer = message_writer
        self._self_test = SelfTest(neighbours(designs))
        self._tested = since
        self._broken: dict[str, int] = {}
        self.faults: list[tuple[str, int, int]] | None = None

    def mark_dead(self, taxel: EmulatedTaxel) -> None:
        """Take over that a taxel is certainly dead, and was reported as such."""
        self._broken[taxel.name], taxel.control_unit.broken = _DEAD_FAULT, True

    def watch(self, number: int, ticks: int) -> list[Record]:
        """Feed a taxel's latest frame, which ended at some ticks; gives what a window has shown."""
        self._taxels[number].feed(number, self._self_test)
        return self._examine(ticks) if ticks - self._tested >= SELF_TEST_WINDOW else []

    def _examine(self, ticks: int) -> list[Record]:
        time = self._clock.enclosure(self._tested)[0], self._clock.enclosure(ticks)[1]
        self._tested = ticks
        records: list[Record] = []
        self.faults = []
        for taxel, found in zip(self._taxels, self._self_test.examine(), strict=True):
            records += self._judge(taxel, found, time)
            # What was certain once, and not refuted since, is certain.
            known = self._broken.get(taxel.name)
            dead, stuck = (CERTAIN if fault == known else found[fault] for fault in (0, 1))
            if (dead, stuck) != (IMPOSSIBLE, IMPOSSIBLE):
                self.faults.append((taxel.name, dead, stuck))
        return records

    def _judge(
        self, taxel: EmulatedTaxel, found: tuple[int, int], time: tuple[int, int]
    ) -> list[Record]:
        unit, known = taxel.control_unit, self._broken.get(taxel.name)
        fault = found.index(CERTAIN) if known is None and CERTAIN in found else known
        if fault is None:
            return []
        records = []
        if known is None or unit.omitted_samples:
            reason = DEAD if fault == _DEAD_FAULT else STUCK
            records.append(
                self._message_writer.gap(reason, time, unit.omitted_samples, taxel=taxel.name)
            )
        self._broken[taxel.name], unit.broken, unit.omitted_samples = fault, True, 0
        if found[fault] == IMPOSSIBLE:
            del self._broken[taxel.name]
            unit.broken = False
        return records
