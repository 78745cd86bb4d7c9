"""A cohort with its members' outboxes, and those who left it to sample alone."""

from __future__ import annotations

import logging
import time
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.messages import Position, ResetCause
from sensor_node.controls import NodeControls
from sensor_node.firmware.reasons import DEAD, OVERRUN, TEXTS
from sensor_node.firmware.record import BLOCK, Record
from sensor_node.fleet.cohort import Cohort, Member
from sensor_node.fleet.outbox import MemberOutbox
from sensor_node.fleet.soloist import Soloist, require_alone
from sensor_node.fleet.watch import Watch
from sensor_node.machine.clock import Clock
from sensor_node.machine.crystal import BILLION, Crystal
from sensor_node.machine.events import NEVER
from sensor_node.truth import TrueBlock

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.messages.vocabulary import State
    from sensor_node.fleet.storage import Storage
    from sensor_node.fleet.taxel import Said
    from sensor_node.settings import NodeSettings
    from sensor_node.truth import Truth

log = logging.getLogger(__name__)

_MOST_FRAMES: Final = 16
"""Frames of one commit."""


class Squad:
    """Some members that sample in step.

    Args:
        settings: Their design.
        names: Their names.
        numbers: Their numbers in the fleet, from which their seeds come.
        seed: The fleet's.
        storage: Where they keep what they say.
        truth: What the emulator keeps.
        start: True UTC in ns at which their emulated time begins.
        origin: The same on the monotonic clock.
        monotonic: That clock, ns.

    Attributes:
        outboxes: One for each member.
        soloists: Members that sample alone, by their rows.
        restarted: Called with a soloist's row after each start of its firmware but the first.
    """

    def __init__(
        self,
        settings: NodeSettings,
        names: Sequence[str],
        numbers: Sequence[int],
        *,
        seed: int,
        storage: Storage,
        truth: Truth,
        start: int,
        origin: int,
        monotonic: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.names = names
        self._settings = settings
        self._truth = truth
        self._origin = origin
        self._monotonic = monotonic
        self.soloists: dict[int, Soloist] = {}
        self.restarted: Callable[[int], None] = lambda _row: None
        self._overrun = int(settings.sampling.overrun_s * settings.node.speed * BILLION)
        chips = [storage.partition(name) for name in names]
        self._members = [
            Member(member_seed(seed, number), chip.boot, start)
            for number, chip in zip(numbers, chips, strict=True)
        ]
        self._cohort = Cohort(settings, self._members)
        self._channels = self._cohort.channels
        self._watch = Watch([taxel.id for taxel in settings.taxel], len(names))
        broker = settings.broker
        self.outboxes = [
            MemberOutbox(
                chip,
                self._cohort.nodes,
                row,
                capacity=settings.flash.capacity_bytes,
                window=broker.window,
                resend_after=round(broker.resend_s * BILLION),
                status_every=round(broker.status_s * BILLION),
            )
            for row, chip in enumerate(chips)
        ]
        if require_alone(settings) is not None:
            for row in range(len(names)):
                self.part(row, self.apart(row))

    @cached_property
    def designed(self) -> State:
        """How a member is set that nobody has set."""
        return NodeControls(self.apart(0)).restore({})

    def apart(self, row: int) -> Soloist:
        """A member as a node of its own, which stands where its cohort does."""
        own, given = self._members[row], self._settings
        random = np.random.default_rng((own.seed, own.boot))
        drift = round(given.clock.drift_ppm * 1e3)
        clock = Clock(
            start=own.start,
            monotonic=self._monotonic,
            speed=given.node.speed,
            rtc_error=round(given.clock.rtc_error_ms * 1e6),
            drift=drift,
            crystal=Crystal(drift, random),
            random=random,
            origin=self._origin,
        )
        node = Soloist(
            given,
            self.names[row],
            clock=clock,
            outbox=self.outboxes[row],
            truth=self._truth,
            seed=own.seed,
        )
        node.take_over(self._cohort, row)
        return node

    def part(self, row: int, node: Soloist) -> None:
        """From now on a member samples alone."""
        self._cohort.nodes.alone[row] = 1
        self.soloists[row] = node
        node.at_start = lambda: self.restarted(row)

    def ticks(self, now: int) -> int:
        """Emulated ns since the start; negative before it."""
        return int((now - self._origin) * self._settings.node.speed)

    def due(self) -> int:
        """When the cohort's next frame is complete, on the monotonic clock in ns."""
        if len(self.soloists) == len(self.names):
            return NEVER
        return self._origin + int(self._cohort.next_due / self._settings.node.speed)

    def sample(self, now: int) -> tuple[dict[int, list[Record]], dict[str, list[TrueBlock]]]:
        """Take the frames that are complete; say so where some were missed.

        Returns:
            What each member (its row) says, and the truth behind the blocks.
        """
        ticks = self.ticks(now)
        records: dict[int, list[Record]] = {}
        truth: dict[str, list[TrueBlock]] = {}
        if ticks - self._cohort.next_due > self._overrun:
            self._pass_over(ticks, records)
        for number, said in enumerate(self._cohort.advance(ticks), start=1):
            self._take(said, records, truth)
            self._examine(said, records)
            if number == _MOST_FRAMES:
                break
        return records, truth

    def finish(self) -> dict[int, list[Record]]:
        """What stays undecided at the end."""
        records: dict[int, list[Record]] = {}
        for said in self._cohort.finish():
            self._take(said, records, {})
        return records

    def enclosure(self, row: int) -> tuple[int, int]:
        """Earliest and latest UTC of the present, as a member knows it."""
        if row in self.soloists:
            return self.soloists[row].enclosure()
        return self._cohort.enclosure(row, self.ticks(self._monotonic()))

    def status(self, row: int, now: int) -> Record:
        """How a member of the cohort fares."""
        ticks, own = self.ticks(now), self._settings.node
        outbox = self.outboxes[row]
        return outbox.scribe.status(
            self._cohort.enclosure(row, ticks),
            own.profile,
            own.description or own.profile,
            max(ticks, 0),
            outbox.usage(),
            self._channels,
            int(ResetCause.POWER_ON),
        )

    def _take(
        self, said: Said, records: dict[int, list[Record]], truth: dict[str, list[TrueBlock]]
    ) -> None:
        times = self._cohort.true_times(said.frame.start)
        boots = self._cohort.nodes.boots.tolist()
        for row, k, kind, sequence, earliest, latest, samples, begin, end in said.records.tolist():
            channel, body = said.taxel.channels[k], said.content[begin:end]
            record = Record(kind, sequence, body, (earliest, latest), samples, 0, channel)
            records.setdefault(row, []).append(record)
            if kind == BLOCK:
                position = Position(boots[row], sequence)
                values = said.truth[k][row]
                true = TrueBlock(position, channel, times[row], said.frame.dt, values)
                truth.setdefault(self.names[row], []).append(true)

    def _examine(self, said: Said, records: dict[int, list[Record]]) -> None:
        """Tell of taxels that a window has shown to be dead."""
        begin, end = self._watch.tested, said.frame.end
        self._watch.take(said.taxel.number, said.bounded)
        for row, name in self._watch.examine(end):
            if row not in self.soloists:
                time = self._cohort.enclosure(row, begin)[0], self._cohort.enclosure(row, end)[1]
                gap = self.outboxes[row].scribe.gap(DEAD, time, 0, taxel=name)
                records.setdefault(row, []).append(gap)

    def _pass_over(self, ticks: int, records: dict[int, list[Record]]) -> None:
        passed, lost, (begin, again) = self._cohort.pass_over(ticks)
        for said in passed:
            self._take(said, records, {})
        together = [row for row in range(len(self.names)) if row not in self.soloists]
        for row in together:
            outbox = self.outboxes[row]
            span = self._cohort.enclosure(row, begin)[0], self._cohort.enclosure(row, again)[1]
            gap = outbox.scribe.gap(OVERRUN, span, lost)
            records.setdefault(row, []).append(gap)
        log.warning(
            "samples lost: reason=%s nodes=%d samples=%d behind_s=%.3f",
            TEXTS[OVERRUN],
            len(together),
            lost * len(together),
            (ticks - begin) / BILLION,
        )


def member_seed(seed: int, number: int) -> int:
    """The seed of the number-th member; a single node with it draws the same parts and noise."""
    return int(np.random.SeedSequence((seed, number)).generate_state(1, np.uint64)[0] >> 1)
