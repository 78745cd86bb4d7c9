"""Nodes of a roster that are set alike: the vectorised twin of `node.node.Node`."""

from __future__ import annotations

import heapq
import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin_sensor_node.fleet.assembler import CohortAssembler
from eskin_sensor_node.fleet.columns import concatenate
from eskin_sensor_node.fleet.report_kernels import GONE, Group
from eskin_sensor_node.fleet.self_test import CohortSelfTest
from eskin_sensor_node.fleet.taxel import TaxelRows, TaxelState

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.fleet.assembler import Written
    from eskin_sensor_node.fleet.roster import Roster
    from eskin_sensor_node.fleet.setting import Setting
    from eskin_sensor_node.fleet.taxel import FrameReport


class Key(NamedTuple):
    """What nodes must have in common to sample together.

    Attributes:
        settings: Of each taxel, how it is set and which frame is next.
        order: Taxels as their next frames will be due.
    """

    settings: tuple[Setting, ...]
    order: tuple[int, ...]


class CohortPart(NamedTuple):
    """Some nodes with the same key.

    Attributes:
        numbers: Which.
        taxels: The state of each taxel.
    """

    numbers: list[int]
    taxels: list[TaxelState]


class Cohort:
    """Samples all taxels of its nodes in step.

    Writes byte for byte what each node would write alone.

    Args:
        roster: All nodes that started together.
        shares: Which of them it has, and their states; without any, all of them at their start.
        order: As in their key.

    Attributes:
        numbers: Which nodes, a row each; `GONE` where one has left.
        taxels: What each has.
        self_test: Looks for dead taxels.
    """

    def __init__(
        self, roster: Roster, shares: Sequence[CohortPart] = (), order: Sequence[int] | None = None
    ) -> None:
        all_members = [CohortPart(list(range(len(roster))), [])]
        found = [number for share in shares or all_members for number in share.numbers]
        self.numbers = np.array(found, np.int64)
        self._roster = roster
        self._clocks = roster.clocks.beside(found)
        given = zip(*(share.taxels for share in shares), strict=True)
        standings = [_together(each) for each in given] if shares else [None] * _taxels(roster)
        self.taxels = [
            TaxelRows(roster, number, self.numbers, clocks=self._clocks, standing=standing)
            for number, standing in enumerate(standings)
        ]
        error, drift = roster.clocks.error, roster.clocks.drift
        self.assembler = CohortAssembler(roster.layout, error=error, drift=drift)
        self._patches = roster.patches
        for number, patch in self._patches.items():
            self.taxels[number].surround(patch.neighbours)
        since = min(each.next.start for each in self.taxels)
        self.self_test = CohortSelfTest(roster, self.numbers, since=since)
        self._order = itertools.count()
        self._due: list[tuple[int, int, int]] = []
        self._arm_all(order or range(len(self.taxels)))

    def __len__(self) -> int:
        return int(np.count_nonzero(self.numbers != GONE))

    def __contains__(self, number: int) -> bool:
        return bool(np.any(self.numbers == number))

    @property
    def key(self) -> Key:
        """What all its nodes have in common."""
        order = tuple(number for _, _, number in sorted(self._due))
        return Key(tuple(taxel.setting for taxel in self.taxels), order)

    @property
    def members(self) -> list[int]:
        """Numbers of the nodes that are still there."""
        found: list[int] = self.numbers[self.numbers != GONE].tolist()
        return found

    def share(self) -> CohortPart:
        """The nodes that are still there, and their states."""
        rows = np.flatnonzero(self.numbers != GONE).tolist()
        return CohortPart(self.members, [taxel.standing(rows) for taxel in self.taxels])

    def row(self, number: int) -> int:
        """Where a node stands here."""
        return int(np.flatnonzero(self.numbers == number)[0])

    def leave(self, number: int) -> None:
        """Remove a node."""
        self.numbers[self.row(number)] = GONE

    @property
    def next_due(self) -> int:
        """Ticks at which the next frame is due."""
        return self._due[0][0]

    def advance(self, ticks: int) -> Iterator[tuple[int, FrameReport]]:
        """Take all frames that are due by now, each with its taxel; the caller writes them."""
        while self.next_due <= ticks:
            number = self._due[0][2]
            if number in self._patches:
                yield from self._sample_skin(self.taxels[number].next)
                continue
            taxel = self.taxels[number]
            yield number, self._take(taxel.sample())
            heapq.heapreplace(self._due, (taxel.next.due, next(self._order), number))

    def flush(self) -> Iterator[Written]:
        """Messages of what was taken."""
        return self.assembler.flush(Group(self._roster.nodes, self.numbers))

    def _take(self, found: FrameReport) -> FrameReport:
        self.assembler.add(found.parts, found.peaks)
        return found

    def _sample_skin(self, frame: Frame) -> list[tuple[int, FrameReport]]:
        """Take the frames of all pads at the same instants, as `node.sampling_group` does."""
        together = [k for k in self._patches if self.taxels[k].next.meets(frame)]
        for k in together:
            self.taxels[k].measure()
        for k in together:
            around = [each for each in self._patches[k].around if each in together]
            self.taxels[k].separate([self.taxels[each] for each in around])
        found = [(k, self._take(self.taxels[k].report())) for k in together]
        self._due = [each for each in self._due if each[2] not in together]
        self._due += [(self.taxels[k].next.due, next(self._order), k) for k in together]
        heapq.heapify(self._due)
        return found

    def pass_over(self, ticks: int) -> tuple[int, tuple[int, int]]:
        """Skip all frames that begin before an instant; takes the peaks that stay undecided.

        Returns:
            How many samples each node lost; from which tick to which nothing was sampled.
        """
        begin, total = min(taxel.next.start for taxel in self.taxels), 0
        for taxel in self.taxels:
            found, lost = taxel.skip(ticks)
            self._take(found)
            total += lost
        self._arm_all(range(len(self.taxels)))
        again = max(taxel.next.start for taxel in self.taxels)
        return total, (begin, again)

    def finish(self) -> None:
        """Take the peaks that stay undecided at the end."""
        for taxel in self.taxels:
            self._take(taxel.skip(0)[0])

    def true_times(self, ticks: int) -> list[int]:
        """True UTC of an instant at each node, row by row, ns."""
        return self._clocks.true_times(ticks)

    def _arm_all(self, order: Sequence[int]) -> None:
        # As in a machine's queue of events: what is armed first comes first.
        self._due = [(self.taxels[k].next.due, next(self._order), k) for k in order]
        heapq.heapify(self._due)


def _together(standings: Sequence[TaxelState]) -> TaxelState:
    """Where one taxel of several shares stands."""
    columns = concatenate([standing.columns for standing in standings])
    return TaxelState(standings[0].setting, columns)


def _taxels(roster: Roster) -> int:
    return len(roster.settings.taxel)
