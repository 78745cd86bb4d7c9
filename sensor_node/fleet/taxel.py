"""One taxel of many nodes of the same design: physics, chain and control unit in columns."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.messages import Encoding
from eskin.peaks.hysteresis import NONE, PASS
from eskin.peaks.region import MOST_REGIONS, REGION
from eskin.peaks.search import MOST_AT_ONCE, PROGRESS
from eskin.peaks.table import EVENT
from sensor_node.firmware.taxel import CHAINS
from sensor_node.fleet.choir import Choir
from sensor_node.fleet.scribe import BLOCK_BYTES, described
from sensor_node.fleet.stacking import stacked
from sensor_node.fleet.telling import RECORD, Design, Output, Search, Timing, skip, tell
from sensor_node.fleet.watch import bounded
from sensor_node.frontend import build_frontend
from sensor_node.machine.compilation import compiled_inversion
from sensor_node.machine.crystal import BILLION
from sensor_node.machine.schedule import build_schedule
from sensor_node.machine.sheet import data_sheet
from sensor_node.physics import Signals, World, build_world
from sensor_node.taxels import HarmonicSection, HybridSection, SwingSection, TouchSection

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from sensor_node.firmware.schedule import Frame
    from sensor_node.fleet.clocks import Clocks
    from sensor_node.fleet.telling import Nodes, Place
    from sensor_node.machine.converter import Codes
    from sensor_node.settings import SamplingSection
    from sensor_node.taxels import AnyTaxel
    from sensor_node.taxels.companion import Companion

_NOWHERE: Final = (NONE, 0, inf, -inf, inf, -inf, -inf)
_PEAK_BYTES: Final = 300
"""More than a peak takes."""
_IN_COLUMNS: Final = HarmonicSection | TouchSection | SwingSection | HybridSection
"""Their worlds are formulas alone; others play a script or a recording."""


@dataclass(frozen=True, slots=True)
class Said:
    """What some nodes say of one frame.

    Attributes:
        taxel: Which taxel's it is.
        records: One row a message, see `sensor_node.fleet.telling.RECORD`.
        content: The messages' bytes, one after the other.
        truth: One array of nodes × samples for each channel; empty where no block is said.
        frame: Of which frame.
        bounded: At which nodes a sample of the first quantity was bounded.
    """

    taxel: TaxelRows
    records: Any
    content: bytes
    truth: tuple[Floats, ...]
    frame: Frame
    bounded: NDArray[np.bool_]


class TaxelRows:
    """Samples one taxel of some nodes, frame by frame, a row for each node.

    Does for many what `sensor_node.emulation.EmulatedTaxel` does for one, bit by bit.

    Args:
        taxel: Its settings.
        number: Its place in the design.
        seeds: The nodes'.
        companions: What it reads along in each node, by the names of its inputs.
        coverage: Probability that its intervals hold the truth.
        clocks: The nodes' clocks.
        nodes: Who they are.
        sampling: How samples become blocks.

    Attributes:
        number: As given.
        searches: Where the searches for peaks stand.
        next: The next frame.
    """

    def __init__(
        self,
        taxel: AnyTaxel,
        number: int,
        *,
        seeds: Sequence[int],
        companions: Sequence[Mapping[str, Companion]],
        coverage: float,
        clocks: Clocks,
        nodes: Nodes,
        sampling: SamplingSection,
    ) -> None:
        randoms = [np.random.default_rng((seed, number)) for seed in seeds]
        worlds = [build_world(taxel, random) for random in randoms]
        self._world = stacked(worlds) if isinstance(taxel, _IN_COLUMNS) else _Worlds(worlds)
        drawn = zip(randoms, companions, strict=True)
        self._frontend = stacked([build_frontend(taxel, *each) for each in drawn])
        self._seeds = [
            (seed, number, boot) for seed, boot in zip(seeds, nodes.boots.tolist(), strict=True)
        ]
        self._clocks = clocks
        self._nodes = nodes
        self.number = number
        self._calibrated = CHAINS[taxel.chain](
            data_sheet(taxel, companions[0]), compiled_inversion()
        )
        self._schedule = build_schedule(taxel, sampling.block_samples)
        quantities = self._calibrated.quantities
        self.quantities = [quantity for quantity, _ in quantities]
        self.channels = [f"{taxel.id}.{quantity}" for quantity in self.quantities]
        units = [unit for _, unit in quantities]
        self._units = units
        schedule = self._schedule
        self._design = Design(
            tuple(described(*each) for each in zip(self.channels, units, strict=True)),
            np.array([taxel.prominence(name) or 0.0 for name in self.quantities]),
            coverage,
            int(Encoding[sampling.encoding.upper()]),
            Timing(
                schedule.origin,
                schedule.dt,
                schedule.burst,
                schedule.pause,
                clocks.error,
                clocks.drift,
            ),
        )
        longest = max(2, round(taxel.longest_region_s * BILLION) // self._schedule.dt)
        self.searches = _searches((len(quantities), len(seeds)), longest)
        self.next = self._schedule.frame(0)

    @property
    def described(self) -> list[tuple[str, str, int, float]]:
        """Name, unit, period and coverage of each channel."""
        dt, coverage = self._schedule.dt, self._design.coverage
        return [
            (name, unit, dt, coverage)
            for name, unit in zip(self.channels, self._units, strict=True)
        ]

    def sample(self) -> Said:
        """Take the next frame of all nodes."""
        self.take()
        self.separate(())
        return self.tell()

    def surround(self, neighbours: int) -> None:
        """Sit among so many neighbours in the skin."""
        self._calibrated.surround(neighbours)

    def take(self) -> None:
        """Measure the next frame of all nodes, as if the taxel were alone; say nothing yet."""
        frame = self.next
        random = Choir((*seed, frame.start) for seed in self._seeds)
        signals = self._world.signals(self._seconds(frame), random)
        digitised = self._frontend.digitise(signals.sensed, random)
        self._truth = signals.truth | digitised.truth
        self._measure(digitised.codes, frame.n)

    def separate(self, around: Sequence[TaxelRows]) -> None:
        """Take back what neighbours hand on that are measured at the same instants, too."""
        felt = [each.felt for each in around]
        self._calibrated.separate(len(self._bounds[0]), self._bounds, felt)

    @property
    def felt(self) -> tuple[Any, Any]:
        """What it hands on a share of, at the instants of the frame that is measured."""
        return self._calibrated.felt(self._bounds)

    def tell(self) -> Said:
        """What all nodes say of the frame that is measured."""
        frame = self.next
        shape = len(self._seeds), frame.n
        lows, highs = (np.stack([b.reshape(shape) for b in self._bounds[k::2]]) for k in (0, 1))
        output = self._room(frame.n, blocks=True)
        given = self._design, self._nodes, self.searches, output
        written = tell(frame.start, frame.closes, lows, highs, *given)
        self.next = self._schedule.frame(frame.number + 1)
        columns = tuple(np.asarray(self._truth[quantity]) for quantity in self.quantities)
        return self._said(frame, output, written, columns, bounded(lows[0], highs[0]))

    def skip(self, ticks: int) -> tuple[Said, int]:
        """Pass over all frames that begin before a moment.

        Returns:
            The peaks that stay undecided, and how many samples each node lost, over all channels.
        """
        frame, lost = self.next, 0
        while self.next.start < ticks:
            lost += self.next.n
            self.next = self._schedule.frame(self.next.number + 1)
        output = self._room(1, blocks=False)
        written = skip(lost, self._design, self._nodes, self.searches, output)
        return self._said(frame, output, written, (), np.zeros(0, bool)), lost * len(self.channels)

    def _measure(self, codes: Mapping[str, Codes], n: int) -> None:
        """Fill a lower and an upper bound a channel, nodes × samples; one data sheet for all."""
        size = len(self._seeds) * n
        given: list[Any] = [codes[name].ravel() for name in self._calibrated.inputs]
        self._bounds: list[Any] = [np.empty(size) for _ in range(2 * len(self.quantities))]
        self._calibrated.measure(given, size, self._bounds)

    def _room(self, n: int, *, blocks: bool) -> Output:
        """Room for the most that a frame can bring; what is not used costs no memory."""
        most = n // 2 + 2 * MOST_AT_ONCE
        each = len(self.quantities) * len(self._seeds)
        messages = each * (most + blocks)
        size = each * (most * _PEAK_BYTES + blocks * (BLOCK_BYTES + 16 * n))
        return Output(np.empty(size, np.uint8), np.empty(messages, RECORD), np.empty(most, EVENT))

    def _said(
        self,
        frame: Frame,
        output: Output,
        written: Place,
        truth: tuple[Floats, ...],
        bounded: NDArray[np.bool_],
    ) -> Said:
        records = output.records[: written.messages].copy()
        return Said(self, records, output.content[: written.at].tobytes(), truth, frame, bounded)

    def _seconds(self, frame: Frame) -> Floats:
        """True seconds since the start, or since the burst's trigger: nodes × samples."""
        ticks = frame.start + frame.dt * np.arange(frame.n, dtype=np.int64)
        since = self._clocks.elapsed(ticks) - self._clocks.elapsed(np.asarray([frame.trigger]))
        return np.asarray(since / BILLION)


class _Worlds:
    """Worlds that do not calculate in columns, one after the other."""

    def __init__(self, worlds: Sequence[World]) -> None:
        self._worlds = worlds

    def signals(self, seconds: Floats, random: Choir) -> Signals:
        """What each gives, as rows."""
        voices = zip(self._worlds, seconds, random.voices, strict=True)
        each = [world.signals(row, voice) for world, row, voice in voices]
        return Signals(
            {name: np.stack([one.truth[name] for one in each]) for name in each[0].truth},
            {name: np.stack([one.sensed[name] for one in each]) for name in each[0].sensed},
        )


def _searches(shape: tuple[int, int], longest: int) -> Search:
    progress = np.zeros(shape, PROGRESS)
    progress["longest"] = longest
    passes = np.empty((*shape, 2), PASS)
    passes[:] = _NOWHERE
    return Search(progress, passes, np.zeros((*shape, MOST_REGIONS + 1), REGION))
