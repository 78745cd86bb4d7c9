"""Signal chains of some nodes in columns: worlds and analogue front ends."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eskin_sensor_node.fleet.stacking import stacked
from eskin_sensor_node.kinds.registry import KINDS
from eskin_sensor_node.kinds.signals import Signals
from eskin_sensor_node.node.taxel import SignalChain

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.fleet.stacking import StackedGenerator
    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.kinds.settings import Companion, TaxelSection
    from eskin_sensor_node.kinds.signals import World


class SensingRows:
    """The true parts of one taxel in some nodes, the twin of `node.signal_chain.SignalChain`.

    Args:
        taxel: Its settings.
        number: Its place in the design.
        seeds: The nodes'.
        companions: What it reads along in each node, by the names of its inputs.
        drawn: The same parts, where they were drawn before.
    """

    def __init__(
        self,
        taxel: TaxelSection,
        number: int,
        seeds: Sequence[int],
        companions: Sequence[Mapping[str, Companion]],
        drawn: Sequence[SignalChain] | None,
    ) -> None:
        each = zip(seeds, companions, strict=True)
        found = drawn or [SignalChain(taxel, (seed, number), along) for seed, along in each]
        in_columns = KINDS[taxel.kind].in_columns
        # What is drawn in a moment need not be kept.
        self._drawn = None if in_columns else found
        worlds = [each.world for each in found]
        self._world = stacked(worlds) if in_columns else _Worlds(worlds)
        self._frontend = stacked([each.frontend for each in found])

    def drawn(self, rows: Sequence[int]) -> list[SignalChain] | None:
        """The parts of some nodes, where they are kept."""
        return None if self._drawn is None else [self._drawn[row] for row in rows]

    def amplify(self, gain: float) -> None:
        """Set all amplifiers."""
        self._frontend.adjust(gain, 0)

    def digitise(
        self, seconds: Floats, random: StackedGenerator
    ) -> tuple[dict[str, Floats], dict[str, Codes]]:
        """What is true, and the converters' codes of it, at instants of nodes × samples."""
        signals = self._world.signals(seconds, random)
        digitised = self._frontend.digitise(signals.sensed, random)
        return signals.truth | digitised.truth, digitised.codes


class _Worlds:
    """Worlds that do not calculate in columns, one after the other."""

    def __init__(self, worlds: Sequence[World]) -> None:
        self._worlds = worlds

    def signals(self, seconds: Floats, random: StackedGenerator) -> Signals:
        """What each gives, as rows."""
        generators = zip(self._worlds, seconds, random.generators, strict=True)
        each = [world.signals(row, generator) for world, row, generator in generators]
        return Signals(
            {name: np.stack([one.truth[name] for one in each]) for name in each[0].truth},
            {name: np.stack([one.sensed[name] for one in each]) for name in each[0].sensed},
        )
