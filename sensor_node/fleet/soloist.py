"""A member that samples alone: where it is set otherwise than the rest, or its design wants it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sensor_node.examiner import Examiner
from sensor_node.fleet.detector import standing
from sensor_node.machine.compilation import compiled_inversion
from sensor_node.neighbours import neighbours
from sensor_node.node import Node
from sensor_node.replay.section import Recorded

if TYPE_CHECKING:
    from sensor_node.firmware.outbox import Outbox
    from sensor_node.fleet.cohort import Cohort
    from sensor_node.machine.clock import Clock
    from sensor_node.settings import NodeSettings
    from sensor_node.truth import Truth


class Soloist(Node):
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
        truth: Truth,
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

    def take_over(self, cohort: Cohort, row: int) -> None:
        """Go on where a member of a cohort stands: the next frames, and the searches for peaks."""
        for taxel, rows in zip(self.taxels, cohort.taxels, strict=True):
            taxel.next = rows.next
            for k, unit in enumerate(taxel.control_unit.units):
                unit.seek(standing(rows.searches, k, row, unit.threshold))
        since = min(taxel.next.start for taxel in self.taxels)
        self._examiner = Examiner(
            self._settings.taxel,
            self.taxels,
            self._clock.known,
            self._outbox.scribe,
            since=since,
        )
        self._line_up()

    @property
    def due(self) -> bool:
        """Whether something is to be done by now."""
        return self.machine.starting or self.next_due <= self._clock.now()

    def catch_up(self) -> None:
        """Do what is due by now."""
        self.advance(self._clock.now())

    def enclosure(self) -> tuple[int, int]:
        """Earliest and latest UTC of the present, as it knows it."""
        return self._clock.known.enclosure(max(0, self._clock.ticks()))


def require_alone(settings: NodeSettings) -> str | None:
    """What in a design cannot be calculated in columns; ``None`` where all can.

    Energy, adaptive control and the comparison of neighbours follow what each node measures; a
    recording has gaps of its own.
    """
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
