"""What converters give of taxels with one data sheet, a column each, and what was true."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eskin_sensor_node.kinds.frontend import Digitised
from eskin_sensor_node.kinds.generator import ColumnGenerator
from eskin_sensor_node.kinds.registry import build_frontend, build_world

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.kinds.settings import Companion, TaxelSection


class Sensed(NamedTuple):
    """What was at some instants, and what the converters gave of it.

    Attributes:
        truth: Each quantity's true values, columns × instants.
        readings: What the converters gave, or where the world is known as intervals, what they
            gave at each end of them.
        missing: At which instants nothing was; ``None``: at none.
    """

    truth: dict[str, Floats]
    readings: Sequence[Digitised]
    missing: NDArray[np.bool_] | None

    def runs(self, n: int) -> Iterator[tuple[int, int, bool]]:
        """Begin and end of each run of instants that are all there or all missing, and whether."""
        if self.missing is None:
            yield 0, n, True
            return
        edges = [0, *(np.flatnonzero(np.diff(self.missing)) + 1).tolist(), n]
        for begin, end in itertools.pairwise(edges):
            yield begin, end, not self.missing[begin]


class SensingColumns:
    """Worlds, analogue chains and converters, down to the codes; they outlive each reset.

    Columns are taxels of one node, or one taxel of many nodes. Sensors that a taxel reads along
    are converted once for all columns of a node.

    Args:
        taxel: The data sheet.
        seeds: Of the columns' nodes, or of the node.
        numbers: Of the taxels in their nodes, or in all nodes.
        companions: What each reads along, by the names of its inputs.
        places: Where they are in their skin; ``None``: all where the taxel is.

    Attributes:
        world: Gives the true signals.
        frontend: Turns them into codes.
    """

    def __init__(
        self,
        taxel: TaxelSection,
        *,
        seeds: ArrayLike,
        numbers: ArrayLike,
        companions: Mapping[str, Companion],
        places: Sequence[str] | None = None,
    ) -> None:
        self._random = ColumnGenerator(seeds, numbers)
        self.world = build_world(taxel, self._random, places)
        self.frontend = build_frontend(taxel, self._random)
        self._along = []
        for name, each in companions.items():
            random = ColumnGenerator(seeds, each.number)
            self._along.append((name, build_frontend(each.taxel, random), random))

    def __len__(self) -> int:
        return len(self._random)

    def sense(self, boots: ArrayLike, instants: NDArray[np.int64], seconds: Floats) -> Sensed:
        """What converters give at some instants.

        Args:
            boots: Of the columns' nodes, or of the node; they draw the noise.
            instants: On the nodes' clocks, ns.
            seconds: The same in true seconds since the start, or since the trigger of a burst:
                columns × instants, or 1 × instants where all columns have one clock.
        """
        for random in (self._random, *(each for _, _, each in self._along)):
            random.begin(boots, instants)
        shape = len(self), len(instants)
        signals = self.world.signals(seconds, self._random)
        digitised = self._digitise(signals.sensed, shape)
        truth = {
            name: np.broadcast_to(values, shape)
            for name, values in (signals.truth | digitised.truth).items()
        }
        ends = [self._digitise(end, shape) for end in signals.ends]
        return Sensed(truth, ends or [digitised], signals.missing)

    def _digitise(self, sensed: Mapping[str, Floats], shape: tuple[int, int]) -> Digitised:
        found = self.frontend.digitise(sensed, self._random)
        codes: dict[str, Codes] = dict(found.codes)
        for name, frontend, random in self._along:
            (along,) = frontend.digitise(sensed, random).codes.values()
            codes[name] = np.broadcast_to(along, shape)
        return Digitised(found.truth, codes, found.held)
