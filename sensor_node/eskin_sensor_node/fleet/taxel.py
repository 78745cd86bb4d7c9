"""One taxel of many nodes of the same design: physics, chain and control unit in columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from eskin.peaks.certain_possible_peaks import MOST_AT_ONCE
from eskin.peaks.table import EVENT
from eskin.wire.messages import Encoding
from eskin_sensor_node.fleet.baseline_kernels import MODES
from eskin_sensor_node.fleet.columns import fresh
from eskin_sensor_node.fleet.message_kernels import (
    GONE,
    RECORD,
    Design,
    Group,
    Output,
    Timing,
    skip,
    write_frame,
)
from eskin_sensor_node.fleet.self_test import bounded
from eskin_sensor_node.fleet.sensing import SensingRows
from eskin_sensor_node.fleet.setting import designed, longest_region
from eskin_sensor_node.fleet.stacking import StackedGenerator
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.compiled_writer import BLOCK_BYTES, described
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.fleet.clocks import ClockColumn
    from eskin_sensor_node.fleet.columns import Columns
    from eskin_sensor_node.fleet.message_kernels import Place
    from eskin_sensor_node.fleet.roster import Roster
    from eskin_sensor_node.fleet.setting import Setting
    from eskin_sensor_node.kinds.converter import Codes
    from eskin_sensor_node.node.taxel import SignalChain

_PEAK_BYTES: Final = 300
"""More than a peak takes."""


class TaxelState(NamedTuple):
    """Where one taxel of some nodes stands.

    Attributes:
        setting: How it is set in all of them.
        columns: What their firmware remembers of it.
        drawn: Their worlds and chains, where they are at hand.
    """

    setting: Setting
    columns: Columns
    drawn: Sequence[SignalChain] | None


@dataclass(frozen=True, slots=True)
class FrameMessages:
    """Messages of some nodes of one frame.

    Attributes:
        taxel: Which taxel's it is.
        records: One row a message, see `eskin_sensor_node.fleet.message_kernels.RECORD`.
        content: The messages' bytes, one after the other.
        truth: One array of nodes × samples for each channel; empty where no block is sent.
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

    Does for many what `eskin_sensor_node.node.taxel.EmulatedTaxel` does for one, bit by bit.

    Args:
        roster: All nodes that started together.
        number: The taxel's place in their design.
        numbers: Which nodes, a row each.
        clocks: Their clocks.
        standing: How it is set and where it stands in all of them; ``None``: as designed, at the
            start.

    Attributes:
        number: As given.
        numbers: As given; `GONE` where one has left.
        columns: What the nodes' firmware remembers.
        next: The next frame.
    """

    def __init__(
        self,
        roster: Roster,
        number: int,
        numbers: NDArray[np.int64],
        *,
        clocks: ClockColumn,
        standing: TaxelState | None = None,
    ) -> None:
        taxel, sampling = roster.settings.taxel[number], roster.settings.sampling
        entries = [roster.entries[each] for each in numbers.tolist()]
        seeds = [each.seed for each in entries]
        companions = [roster.settings.companions(taxel, seed) for seed in seeds]
        setting = designed(taxel, sampling.block_samples) if standing is None else standing.setting
        drawn = None if standing is None else standing.drawn
        self._sensing = SensingRows(taxel, number, seeds, companions, drawn)
        self._sensing.amplify(setting.gain)
        self._seeds = [(each.seed, number, each.boot) for each in entries]
        self._clocks = clocks
        self._group = Group(roster.nodes, numbers)
        self.number = number
        self.numbers = numbers
        self._calibrated = taxel.firmware(data_sheet(taxel, companions[0]), compiled_inversion())
        self._calibrated.adjust(setting.gain, 0)
        self._setting, self._schedule = setting, setting.schedule
        quantities = self._calibrated.quantities
        self.quantities = [quantity for quantity, _ in quantities]
        self.channels = [f"{taxel.id}.{quantity}" for quantity in self.quantities]
        self._units = [unit for _, unit in quantities]
        clock = roster.clocks.error, roster.clocks.drift
        self._design = self._designed(roster.coverages[number], sampling.encoding, clock)
        longest = longest_region(taxel, self._schedule.dt)
        self.columns = (
            fresh(len(quantities), len(seeds), longest) if standing is None else standing.columns
        )
        self.next = self._schedule.frame(setting.number)

    def _designed(self, coverage: float, encoding: str, clock: tuple[int, int]) -> Design:
        setting, schedule = self._setting, self._schedule
        channels = zip(self.channels, self._units, strict=True)
        names = [described(*each) for each in channels]
        return Design(
            np.concatenate(names),
            np.cumsum([0, *(name.size for name in names)]),
            np.array(setting.thresholds),
            coverage,
            int(Encoding[encoding.upper()]),
            MODES.index(setting.mode),
            setting.smoothing,
            Timing(schedule.origin, schedule.dt, schedule.burst, schedule.pause, *clock),
        )

    @property
    def setting(self) -> Setting:
        """How it is set now, and which frame is next."""
        return self._setting._replace(number=self.next.number)

    def standing(self, rows: Sequence[int]) -> TaxelState:
        """Where it stands in some of its nodes."""
        return TaxelState(self.setting, self.columns.of(rows), self._sensing.drawn(rows))

    @property
    def described(self) -> list[tuple[str, str, int, float]]:
        """Name, unit, period and coverage of each channel."""
        dt, coverage = self._schedule.dt, self._design.coverage
        return [
            (name, unit, dt, coverage)
            for name, unit in zip(self.channels, self._units, strict=True)
        ]

    def sample(self) -> FrameMessages:
        """Take the next frame of all nodes."""
        self.measure()
        self.separate(())
        return self.report()

    def surround(self, neighbours: int) -> None:
        """Sit among so many neighbours in the skin."""
        self._calibrated.surround(neighbours)

    def measure(self) -> None:
        """Measure the next frame of all nodes, as if the taxel were alone, without messages."""
        frame = self.next
        random = StackedGenerator((*seed, frame.start) for seed in self._seeds)
        self._truth, codes = self._sensing.digitise(self._seconds(frame), random)
        self._measure(codes, frame.n)

    def separate(self, around: Sequence[TaxelRows]) -> None:
        """Take back what neighbours hand on that are measured at the same instants, too."""
        felt = [each.felt for each in around]
        self._calibrated.separate(len(self._bounds[0]), self._bounds, felt)

    @property
    def felt(self) -> tuple[Any, Any]:
        """What it hands on a share of, at the instants of the frame that is measured."""
        return self._calibrated.felt(self._bounds)

    def report(self) -> FrameMessages:
        """Messages of all nodes of the frame that was measured."""
        frame = self.next
        shape = len(self._seeds), frame.n
        lows, highs = (np.stack([b.reshape(shape) for b in self._bounds[k::2]]) for k in (0, 1))
        output = self._room(frame.n, blocks=True)
        given = self._design, self._group, self.columns, output
        written = write_frame(frame.start, frame.closes, lows, highs, *given)
        self.next = self._schedule.frame(frame.number + 1)
        columns = tuple(np.asarray(self._truth[quantity]) for quantity in self.quantities)
        return self._messages(frame, output, written, columns, bounded(lows[0], highs[0]))

    def skip(self, ticks: int) -> tuple[FrameMessages, int]:
        """Pass over all frames that begin before a moment.

        Returns:
            The peaks that stay undecided, and how many samples each node lost, over all channels.
        """
        frame, lost = self.next, 0
        while self.next.start < ticks:
            lost += self.next.n
            self.next = self._schedule.frame(self.next.number + 1)
        output = self._room(1, blocks=False)
        written = skip(lost, self._design, self._group, self.columns, output)
        messages = self._messages(frame, output, written, (), np.zeros(0, bool))
        return messages, lost * len(self.channels)

    def leave(self, row: int) -> None:
        """A node is no more one of these."""
        self.numbers[row] = GONE

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

    def _messages(
        self,
        frame: Frame,
        output: Output,
        written: Place,
        truth: tuple[Floats, ...],
        bounded: NDArray[np.bool_],
    ) -> FrameMessages:
        records = output.records[: written.messages].copy()
        return FrameMessages(
            self, records, output.content[: written.at].tobytes(), truth, frame, bounded
        )

    def _seconds(self, frame: Frame) -> Floats:
        """True seconds since the start, or since the burst's trigger: nodes × samples."""
        ticks = frame.start + frame.dt * np.arange(frame.n, dtype=np.int64)
        since = self._clocks.elapsed(ticks) - self._clocks.elapsed(np.asarray([frame.trigger]))
        return np.asarray(since / BILLION)
