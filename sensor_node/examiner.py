"""The node's look at its own taxels: which of them are certainly broken."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sensor_node.firmware.selftest import CERTAIN, SelfTest
from sensor_node.machine.crystal import BILLION
from sensor_node.neighbours import neighbours

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sensor_node.emulation import EmulatedTaxel
    from sensor_node.firmware.clock import Clock
    from sensor_node.firmware.record import Record, Scribe
    from sensor_node.taxels import AnyTaxel

SELF_TEST: Final = 20 * BILLION
"""Ticks of a window in which stuck and dead taxels are looked for."""


class Examiner:
    """Lets the firmware's self-test see each frame, and tells of what is broken, once in a boot.

    Args:
        taxels: The node's, in their order.
        clock: What the node knows of time.
        scribe: Writes its messages.
        since: Ticks at which the first window begins.
    """

    def __init__(
        self, taxels: Sequence[AnyTaxel], clock: Clock, scribe: Scribe, *, since: int = 0
    ) -> None:
        self._names = [taxel.id for taxel in taxels]
        self._clock = clock
        self._scribe = scribe
        self._self_test = SelfTest(neighbours(taxels))
        self._tested = since
        self._broken: set[str] = set()

    def watch(self, number: int, taxel: EmulatedTaxel, ticks: int) -> list[Record]:
        """See a taxel's latest frame, which ended at some ticks; tells what a window has shown."""
        taxel.show(number, self._self_test)
        return self._examine(ticks) if ticks - self._tested >= SELF_TEST else []

    def _examine(self, ticks: int) -> list[Record]:
        time = self._clock.enclosure(self._tested)[0], self._clock.enclosure(ticks)[1]
        self._tested = ticks
        said = []
        for name, (dead, stuck) in zip(self._names, self._self_test.examine(), strict=True):
            if CERTAIN in (dead, stuck) and name not in self._broken:
                self._broken.add(name)
                kind = "dead" if dead == CERTAIN else "stuck"
                said.append(self._scribe.gap(f"{name} certainly {kind}", time, 0))
        return said
