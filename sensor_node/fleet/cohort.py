"""Nodes of one design that started together: the vectorised twin of `sensor_node.node.Node`."""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sensor_node.firmware.record import Channel
from sensor_node.fleet.clocks import Clocks
from sensor_node.fleet.taxel import TaxelRows
from sensor_node.fleet.telling import Nodes
from sensor_node.neighbours import patches

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sensor_node.firmware.schedule import Frame
    from sensor_node.fleet.taxel import Said
    from sensor_node.settings import NodeSettings


@dataclass(frozen=True, slots=True)
class Member:
    """One node of a cohort.

    Attributes:
        seed: Draws its true parts and its noise.
        boot: Number of this start.
        start: True UTC at its tick 0, ns.
    """

    seed: int
    boot: int
    start: int


class Cohort:
    """Samples all taxels of its members in step.

    Says byte for byte what each member would say alone.

    Args:
        settings: The members' design; what they do not share is not looked at.
        members: Who they are.

    Attributes:
        nodes: What the members know, and their next numbers.
        taxels: What each has.
    """

    def __init__(self, settings: NodeSettings, members: Sequence[Member]) -> None:
        boots = np.array([member.boot for member in members], np.int64)
        self._clocks = Clocks(
            [member.start for member in members],
            [np.random.default_rng((member.seed, member.boot)) for member in members],
            error=round(settings.clock.rtc_error_ms * 1e6),
            drift=round(settings.clock.drift_ppm * 1e3),
        )
        self.nodes = Nodes(
            self._clocks.readings, boots, *(np.zeros(len(members), np.int64) for _ in range(2))
        )
        coverages = settings.coverages()
        self.taxels = [
            TaxelRows(
                taxel,
                number,
                seeds=[member.seed for member in members],
                companions=[settings.companions(taxel, member.seed) for member in members],
                coverage=coverages[number],
                clocks=self._clocks,
                nodes=self.nodes,
                sampling=settings.sampling,
            )
            for number, taxel in enumerate(settings.taxel)
        ]
        self._patches = patches(settings.taxel)
        for number, patch in self._patches.items():
            self.taxels[number].surround(patch.neighbours)
        self._order = itertools.count()
        self._due: list[tuple[int, int, int]] = []
        self._line_up()

    def __len__(self) -> int:
        return len(self.nodes.boots)

    @property
    def next_due(self) -> int:
        """Ticks at which the next frame is complete."""
        return self._due[0][0]

    def advance(self, ticks: int) -> Iterator[Said]:
        """Take all frames that are complete by now."""
        while self.next_due <= ticks:
            number = self._due[0][2]
            if number in self._patches:
                yield from self._sample_skin(self.taxels[number].next)
                continue
            taxel = self.taxels[number]
            yield taxel.sample()
            heapq.heapreplace(self._due, (taxel.next.end, next(self._order), number))

    def _sample_skin(self, frame: Frame) -> list[Said]:
        """Take the frames of all pads at the same instants, as `sensor_node.scan.Scan` does."""
        together = [k for k in self._patches if self.taxels[k].next.meets(frame)]
        for k in together:
            self.taxels[k].take()
        for k in together:
            around = [each for each in self._patches[k].around if each in together]
            self.taxels[k].separate([self.taxels[each] for each in around])
        said = [self.taxels[k].tell() for k in together]
        self._due = [each for each in self._due if each[2] not in together]
        self._due += [(self.taxels[k].next.end, next(self._order), k) for k in together]
        heapq.heapify(self._due)
        return said

    def pass_over(self, ticks: int) -> tuple[list[Said], int, tuple[int, int]]:
        """Give up all frames that begin before a moment.

        Returns:
            The peaks that stay undecided; how many samples each node lost; from which tick to which
            nothing was sampled.
        """
        begin = min(taxel.next.start for taxel in self.taxels)
        passed = [taxel.skip(ticks) for taxel in self.taxels]
        self._line_up()
        again = max(taxel.next.start for taxel in self.taxels)
        return [said for said, _ in passed], sum(lost for _, lost in passed), (begin, again)

    def finish(self) -> list[Said]:
        """The peaks that stay undecided at the end."""
        return [taxel.skip(0)[0] for taxel in self.taxels]

    def true_times(self, ticks: int) -> list[int]:
        """True UTC of a moment at each member, ns."""
        return self._clocks.true_times(ticks)

    def enclosure(self, row: int, ticks: int) -> tuple[int, int]:
        """Earliest and latest UTC of a moment, as a member knows it; also before its start."""
        # Drift counts in either direction from the moment at which the clock was read.
        return self._clocks.known(row).enclosure(ticks, max(0, -2 * ticks))

    @property
    def channels(self) -> list[Channel]:
        """What each member measures."""
        return [Channel(*given) for taxel in self.taxels for given in taxel.described]

    def _line_up(self) -> None:
        # As in a machine's queue of events: what is armed first comes first.
        self._due = [
            (taxel.next.end, next(self._order), number) for number, taxel in enumerate(self.taxels)
        ]
        heapq.heapify(self._due)
