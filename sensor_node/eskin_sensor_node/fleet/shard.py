"""Members that started together: outboxes, cohorts, and nodes that sample alone."""

from __future__ import annotations

import functools
import logging
import time
from functools import cached_property, partial
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.wire.messages import Position, ResetCause
from eskin_sensor_node.firmware.gap_reasons import DEAD, OVERRUN, TEXTS
from eskin_sensor_node.firmware.message_writer import FRAME, MessageWriter, Record
from eskin_sensor_node.fleet.cohort import Cohort
from eskin_sensor_node.fleet.outbox import MemberOutbox
from eskin_sensor_node.fleet.regroup import Regroup
from eskin_sensor_node.fleet.roster import Roster, RosterEntry
from eskin_sensor_node.fleet.single_node import SingleNode, reason_to_sample_alone
from eskin_sensor_node.machine.flash.flash import Partition
from eskin_sensor_node.machine.machine import NEVER
from eskin_sensor_node.node.commands import NodeControls
from eskin_sensor_node.node.factory import build_clock
from eskin_sensor_node.node.ground_truth import TrueFrame
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from eskin.wire.messages.command import State
    from eskin_sensor_node.fleet.taxel import FrameReport
    from eskin_sensor_node.machine.flash.file import FlashFile
    from eskin_sensor_node.node.ground_truth import GroundTruth
    from eskin_sensor_node.settings import NodeSettings

log = logging.getLogger(__name__)

_MOST_FRAMES: Final = 16
"""Frames of one commit."""


class Shard:
    """Some members that started together; those that are set alike sample in step.

    Args:
        settings: Their design.
        names: Their names.
        numbers: Their numbers in the fleet, from which their seeds come.
        seed: The fleet's.
        storage: Their flash file.
        truth: The ground truth.
        start: True UTC in ns at which their emulated time begins.
        origin: The same on the monotonic clock.
        monotonic: That clock, ns.

    Attributes:
        outboxes: One for each member.
        cohorts: Members that sample together.
        singles: Members that sample alone, by their rows.
        restarted: Called with a single node's row after each start of its firmware but the first.
    """

    def __init__(
        self,
        settings: NodeSettings,
        names: Sequence[str],
        numbers: Sequence[int],
        *,
        seed: int,
        storage: FlashFile,
        truth: GroundTruth,
        start: int,
        origin: int,
        monotonic: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.names = names
        self._settings = settings
        self._truth = truth
        self._origin = origin
        self._monotonic = monotonic
        self.singles: dict[int, SingleNode] = {}
        self.restarted: Callable[[int], None] = lambda _row: None
        self._overrun = int(settings.sampling.overrun_s * settings.node.speed * BILLION)
        chips = [Partition(storage, name) for name in names]
        entries = [
            RosterEntry(member_seed(seed, number), chip.boot, start)
            for number, chip in zip(numbers, chips, strict=True)
        ]
        self._roster = Roster(settings, entries)
        self.cohorts = [Cohort(self._roster)]
        self._regroup = Regroup(self._roster)
        broker, described = settings.broker, self._roster.layout.described
        self._layout = described.layout
        writer = partial(MessageWriter, layout=self._layout)
        self.outboxes = [
            MemberOutbox(
                chip,
                self._roster.nodes,
                row,
                capacity=settings.flash.capacity_bytes,
                window=broker.window,
                resend_after=round(broker.resend_s * BILLION),
                status_every=round(broker.status_s * BILLION),
                message_writer=writer,
            )
            for row, chip in enumerate(chips)
        ]
        with storage.commit():
            for outbox in self.outboxes:
                outbox.describe(*described)
        self._alone = reason_to_sample_alone(settings) is not None
        if self._alone:
            for row in range(len(names)):
                self.part(row, self.make_single(row))

    @cached_property
    def designed(self) -> State:
        """The state of a member as designed."""
        return NodeControls(self._single(0)).restore({})

    def make_single(self, row: int) -> SingleNode:
        """A member as a single node, in the state of its cohort."""
        node = self._single(row)
        node.take_over(self._cohort(row), row)
        for taxel in np.flatnonzero(self._roster.dead[:, row]).tolist():
            node.mark_dead(taxel)
        return node

    def part(self, row: int, node: SingleNode) -> None:
        """A member samples alone, until it is set like others again."""
        if row not in self.singles:
            self._cohort(row).leave(row)
            self.cohorts = [cohort for cohort in self.cohorts if len(cohort)]
        self.singles[row] = node
        node.at_start = lambda: self.restarted(row)
        self._regroup.postpone(self._monotonic())

    def regroup(self, *, at_once: bool = False) -> None:
        """Regroup members that are set alike, some seconds after the last command."""
        now = self._monotonic()
        if self._alone or not (at_once or self._regroup.is_due(now)):
            return
        for row in self._regroup.regroup(self.cohorts, self.singles, now):
            del self.singles[row]
            self.outboxes[row].end_savepoint()

    def _cohort(self, row: int) -> Cohort:
        return next(cohort for cohort in self.cohorts if row in cohort)

    def _single(self, row: int) -> SingleNode:
        """A member as a single node that has just started."""
        own, given = self._roster.entries[row], self._settings
        clock = build_clock(
            given,
            seed=own.seed,
            boot=own.boot,
            start=own.start,
            monotonic=self._monotonic,
            origin=self._origin,
        )
        return SingleNode(
            given,
            self.names[row],
            clock=clock,
            outbox=self.outboxes[row],
            truth=self._truth,
            seed=own.seed,
        )

    def ticks(self, now: int) -> int:
        """Emulated ns since the start; negative before it."""
        return int((now - self._origin) * self._settings.node.speed)

    def due(self) -> int:
        """When a cohort's next frame is complete, on the monotonic clock in ns."""
        due = min((cohort.next_due for cohort in self.cohorts), default=NEVER)
        return due if due == NEVER else self._origin + int(due / self._settings.node.speed)

    def sample(self, now: int) -> tuple[dict[int, list[Record]], dict[str, list[TrueFrame]]]:
        """Sample the frames that are due; a gap reports those that were missed.

        Returns:
            Messages by the member's row, and the truth behind frames.
        """
        ticks = self.ticks(now)
        records: dict[int, list[Record]] = {}
        truth: dict[str, list[TrueFrame]] = {}
        for cohort in self.cohorts:
            if ticks - cohort.next_due > self._overrun:
                self._skip_overrun(cohort, ticks, records, truth)
            taken = 0
            while cohort.next_due <= ticks and taken < _MOST_FRAMES:
                broken: set[int] = set()
                for number, found in cohort.advance(cohort.next_due):
                    broken |= self._examine(cohort, number, found, records)
                    taken += 1
                self._take(cohort, records, truth)
                for row in broken - self.singles.keys():
                    # From now on its taxel reports no derived quantity.
                    self.part(row, self.make_single(row))
        return records, truth

    def finish(self) -> dict[int, list[Record]]:
        """What stays undecided at the end."""
        records: dict[int, list[Record]] = {}
        for cohort in self.cohorts:
            cohort.finish()
            self._take(cohort, records, {})
        return records

    def enclosure(self, row: int) -> tuple[int, int]:
        """Earliest and latest UTC of the present, as a member knows it."""
        if row in self.singles:
            return self.singles[row].enclosure()
        return self._roster.enclosure(row, self.ticks(self._monotonic()))

    def settled(self, names: Iterable[str]) -> dict[str, tuple[int, int]]:
        """Position of each member below which all was stored, or is named by a gap."""
        rows = {name: row for row, name in enumerate(self.names)}
        return {name: self.outboxes[rows[name]].settled for name in names}

    def status(self, row: int, now: int) -> Record:
        """The status of a member of a cohort."""
        ticks, own = self.ticks(now), self._settings.node
        outbox = self.outboxes[row]
        return outbox.message_writer.status(
            self._roster.enclosure(row, ticks),
            own.profile,
            own.description or own.profile,
            max(ticks, 0),
            outbox.usage(),
            int(ResetCause.POWER_ON),
            held=outbox.held(),
            ended=outbox.ended(),
        )

    def _take(
        self, cohort: Cohort, records: dict[int, list[Record]], truth: dict[str, list[TrueFrame]]
    ) -> None:
        """Write what a cohort has taken."""
        boots, numbers = self._roster.nodes.boots.tolist(), cohort.numbers.tolist()
        times = functools.cache(cohort.true_times)
        for written in cohort.flush():
            number = numbers[written.row]
            record = Record(
                written.kind, written.sequence, written.body, written.time, written.samples
            )
            records.setdefault(number, []).append(record)
            if written.kind == FRAME:
                begin, end = (times(each)[written.row] for each in (written.begin, written.end))
                position = Position(boots[number], written.sequence)
                lasting = written.end - written.begin
                frame = TrueFrame(
                    position,
                    self._layout,
                    written.begin,
                    lasting,
                    begin,
                    end,
                    written.sizes,
                    written.values,
                )
                truth.setdefault(self.names[number], []).append(frame)

    def _examine(
        self, cohort: Cohort, number: int, found: FrameReport, records: dict[int, list[Record]]
    ) -> set[int]:
        """Report taxels that a window has shown to be dead; gives nodes that must sample alone."""
        begin, end = cohort.self_test.tested, found.frame.due
        cohort.self_test.take(number, *found.bounds)
        broken = set()
        for row, k in cohort.self_test.examine(end):
            taxel = self._settings.taxel[k]
            gap = self._gap(row, DEAD, begin, end, 0, taxel=taxel.id)
            records.setdefault(row, []).append(gap)
            if taxel.firmware.derived:
                broken.add(row)
        return broken

    def _skip_overrun(
        self,
        cohort: Cohort,
        ticks: int,
        records: dict[int, list[Record]],
        truth: dict[str, list[TrueFrame]],
    ) -> None:
        lost, (begin, again) = cohort.pass_over(ticks)
        self._take(cohort, records, truth)
        together = cohort.members
        for row in together:
            records.setdefault(row, []).append(self._gap(row, OVERRUN, begin, again, lost))
        log.warning(
            "samples lost: reason=%s nodes=%d samples=%d behind_s=%.3f",
            TEXTS[OVERRUN],
            len(together),
            lost * len(together),
            (ticks - begin) / BILLION,
        )

    def _gap(
        self, row: int, reason: int, begin: int, end: int, samples: int, *, taxel: str = ""
    ) -> Record:
        """The gap of samples that a member lost between two ticks."""
        time = self._roster.enclosure(row, begin)[0], self._roster.enclosure(row, end)[1]
        return self.outboxes[row].message_writer.gap(reason, time, samples, taxel=taxel)


def member_seed(seed: int, number: int) -> int:
    """The seed of the number-th member; a single node with it draws the same parts and noise."""
    return int(np.random.SeedSequence((seed, number)).generate_state(1, np.uint64)[0] >> 1)
