"""One taxel of many nodes of the same design: physics, chain and control unit in columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eskin.peaks.certain_possible_peaks import MOST_AT_ONCE
from eskin.peaks.table import EVENT
from eskin_sensor_node.columns.sensing import SensingColumns
from eskin_sensor_node.fleet.assembler import ChannelStretch
from eskin_sensor_node.fleet.baseline_kernels import MODES
from eskin_sensor_node.fleet.columns import fresh
from eskin_sensor_node.fleet.report_kernels import (
    GONE,
    PEAK,
    Group,
    TaxelDesign,
    Timing,
    report,
    skip,
)
from eskin_sensor_node.fleet.setting import designed, longest_region
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import data_sheet
from eskin_sensor_node.timebase import BILLION

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.firmware.schedule import Frame
    from eskin_sensor_node.fleet.clocks import Clocks
    from eskin_sensor_node.fleet.columns import Columns
    from eskin_sensor_node.fleet.roster import Roster
    from eskin_sensor_node.fleet.setting import Setting
    from eskin_sensor_node.kinds.converter import Codes


class TaxelState(NamedTuple):
    """Where one taxel of some nodes stands.

    Attributes:
        setting: How it is set in all of them.
        columns: What their firmware remembers of it.
    """

    setting: Setting
    columns: Columns


class FrameReport(NamedTuple):
    """What some nodes report of one frame of one taxel.

    Attributes:
        frame: Which frame.
        parts: Of each channel; none where nothing was sampled.
        peaks: Decided peaks, see `eskin_sensor_node.fleet.report_kernels.PEAK`.
        bounds: Lower and upper ones of the first quantity, nodes × samples.
    """

    frame: Frame
    parts: Sequence[ChannelStretch]
    peaks: Any
    bounds: tuple[Floats, Floats]


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
        clocks: Clocks,
        standing: TaxelState | None = None,
    ) -> None:
        taxel, sampling = roster.settings.taxel[number], roster.settings.sampling
        companions = roster.settings.companions(taxel)
        self._columns, most = roster.layout.columns[number], roster.layout.most[number]
        setting = designed(taxel, sampling, most) if standing is None else standing.setting
        self._sensing = SensingColumns(
            taxel, seeds=roster.seeds[numbers], numbers=number, companions=companions
        )
        self._sensing.frontend.adjust(setting.gain, 0)
        self._boots = roster.nodes.boots[numbers]
        self._clocks = clocks
        self._group = Group(roster.nodes, numbers)
        self.number = number
        self.numbers = numbers
        self._calibrated = taxel.firmware(data_sheet(taxel, companions), compiled_inversion())
        self._calibrated.adjust(setting.gain, 0)
        self._setting, self._schedule = setting, setting.schedule
        quantities = self._calibrated.quantities
        self.quantities = [quantity for quantity, _ in quantities]
        self.channels = [f"{taxel.id}.{quantity}" for quantity in self.quantities]
        clock = roster.clocks.error, roster.clocks.drift
        self._design = self._designed(roster.coverages[number], clock)
        longest = longest_region(taxel, self._schedule.dt)
        self.columns = (
            fresh(len(quantities), len(numbers), longest) if standing is None else standing.columns
        )
        self.next = self._schedule.frame(setting.first)

    def _designed(self, coverage: float, clock: tuple[int, int]) -> TaxelDesign:
        setting, schedule = self._setting, self._schedule
        return TaxelDesign(
            np.array([patch.number for patch, _ in self._columns], np.int64),
            np.array([column for _, column in self._columns], np.int64),
            np.array(setting.thresholds),
            coverage,
            MODES.index(setting.mode),
            setting.smoothing,
            Timing(schedule.origin, schedule.dt, schedule.burst, schedule.pause, *clock),
        )

    @property
    def setting(self) -> Setting:
        """How it is set now, and which frame is next."""
        return self._setting._replace(first=self.next.first)

    def standing(self, rows: Sequence[int]) -> TaxelState:
        """Where it stands in some of its nodes."""
        return TaxelState(self.setting, self.columns.of(rows))

    def sample(self) -> FrameReport:
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
        instants = frame.start + frame.dt * np.arange(frame.n, dtype=np.int64)
        since = self._clocks.elapsed(instants) - self._clocks.elapsed(np.asarray([frame.trigger]))
        sensed = self._sensing.sense(self._boots, instants, np.asarray(since / BILLION))
        self._truth = sensed.truth
        self._measure(sensed.readings[0].codes, frame.n)

    def separate(self, around: Sequence[TaxelRows]) -> None:
        """Take back what neighbours hand on that are measured at the same instants, too."""
        felt = [each.felt for each in around]
        self._calibrated.separate(len(self._bounds[0]), self._bounds, felt)

    @property
    def felt(self) -> tuple[Any, Any]:
        """What it hands on a share of, at the instants of the frame that is measured."""
        return self._calibrated.felt(self._bounds)

    def report(self) -> FrameReport:
        """What all nodes report of the frame that was measured."""
        frame = self.next
        shape = len(self._boots), frame.n
        lows, highs = (np.stack([b.reshape(shape) for b in self._bounds[k::2]]) for k in (0, 1))
        # Smoothing changes the bounds in which peaks are sought.
        given = (lows.copy(), highs.copy()) if self._design.smoothing > 0.0 else (lows, highs)
        sent = np.zeros(lows.shape[:2], np.bool_)
        peaks, events = self._room(frame.n)
        count = report(
            frame.closes,
            given[0],
            given[1],
            self._design,
            self._group,
            self.columns,
            sent,
            peaks,
            events,
        )
        self.next = self._schedule.following(frame)
        parts = [
            ChannelStretch(
                patch, column, frame, self._design.coverage, lows[k], highs[k], truth, sent[k]
            )
            for k, ((patch, column), truth) in enumerate(
                zip(self._columns, map(self._truth.__getitem__, self.quantities), strict=True)
            )
        ]
        return FrameReport(frame, parts, peaks[:count].copy(), (lows[0], highs[0]))

    def skip(self, ticks: int) -> tuple[FrameReport, int]:
        """Skip all frames that begin before an instant.

        Returns:
            The peaks that stay undecided, and how many samples each node lost, over all channels.
        """
        frame, lost = self.next, 0
        while self.next.start < ticks:
            lost += self.next.n
            self.next = self._schedule.following(self.next)
        peaks, events = self._room(1)
        count = skip(lost, self._design, self._group, self.columns, peaks, events)
        none = np.empty((0, 0))
        found = FrameReport(frame, (), peaks[:count].copy(), (none, none))
        return found, lost * len(self.channels)

    def leave(self, row: int) -> None:
        """A node is no more one of these."""
        self.numbers[row] = GONE

    def _measure(self, codes: Mapping[str, Codes], n: int) -> None:
        """Fill a lower and an upper bound a channel, nodes × samples; one data sheet for all."""
        size = len(self._boots) * n
        given: list[Any] = [codes[name].ravel() for name in self._calibrated.inputs]
        self._bounds: list[Any] = [np.empty(size) for _ in range(2 * len(self.quantities))]
        self._calibrated.measure(given, size, self._bounds)

    def _room(self, n: int) -> tuple[Any, Any]:
        """Room for the most peaks of a frame, and of one piece; unused room costs no memory."""
        most = n // 2 + 2 * MOST_AT_ONCE
        peaks = np.empty(len(self.quantities) * len(self._boots) * most, PEAK)
        return peaks, np.empty(most, EVENT)
