"""Nodes of one design that started together: seeds, boots and clocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.fleet.clocks import Clocks
from eskin_sensor_node.fleet.report_kernels import Nodes
from eskin_sensor_node.kinds.neighbours import patches
from eskin_sensor_node.machine.data_sheet import taxel_coverages
from eskin_sensor_node.machine.node_layout import plan_layout

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin_sensor_node.settings import NodeSettings


@dataclass(frozen=True, slots=True)
class RosterEntry:
    """One of the nodes.

    Attributes:
        seed: Draws its true parts and its noise.
        boot: Number of this start.
        start: True UTC at its tick 0, ns.
    """

    seed: int
    boot: int
    start: int


class Roster:
    """What nodes have from their start on.

    Args:
        settings: Their design; what they do not share is not used.
        entries: The nodes.

    Attributes:
        settings: As given.
        entries: As given.
        seeds: The nodes'.
        nodes: What they know, and their next numbers.
        clocks: Their clocks.
        coverages: Of each taxel, the probability that its intervals hold the truth.
        patches: Where pads sit in their skin.
        layout: How their channels are described.
        dead: Which taxels of which nodes are known to be dead, taxels × nodes.
    """

    def __init__(self, settings: NodeSettings, entries: Sequence[RosterEntry]) -> None:
        self.settings = settings
        self.entries = entries
        self.seeds = np.array([each.seed for each in entries], np.uint64)
        boots = np.array([each.boot for each in entries], np.int64)
        self.clocks = Clocks(
            np.array([each.start for each in entries], np.int64),
            self.seeds,
            boots,
            error=round(settings.clock.rtc_error_ms * 1e6),
            drift=round(settings.clock.drift_ppm * 1e3),
        )
        self.nodes = Nodes(self.clocks.readings, boots, np.zeros(len(entries), np.int64))
        self.coverages = taxel_coverages(settings)
        self.patches = patches(settings.taxel)
        self.layout = plan_layout(settings)
        self.dead = np.zeros((len(settings.taxel), len(entries)), np.bool_)

    def __len__(self) -> int:
        return len(self.entries)

    def enclosure(self, row: int, ticks: int) -> tuple[int, int]:
        """Earliest and latest UTC of an instant, as a node knows it; also before its start."""
        # Drift counts in either direction from the instant at which the clock was read.
        return self.clocks.known(row).enclosure(ticks, max(0, -2 * ticks))
