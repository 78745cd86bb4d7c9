"""A skin of equal pads, a column each: physics, chain, converter, firmware."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.wire.frames import Grid
from eskin_sensor_node.columns.inversion import PadColumnsInversion, surroundings
from eskin_sensor_node.columns.self_test import ColumnsSelfTest
from eskin_sensor_node.columns.sensing import SensingColumns
from eskin_sensor_node.columns.stretch import PatchColumns, SkinStretch
from eskin_sensor_node.columns.taxel import ColumnTaxel
from eskin_sensor_node.firmware.schedule import Frame
from eskin_sensor_node.firmware.selftest import CERTAIN, IMPOSSIBLE
from eskin_sensor_node.machine.compilation import compiled_inversion
from eskin_sensor_node.machine.data_sheet import coverage, data_sheet
from eskin_sensor_node.timebase import BILLION
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_sensor_node.columns.plan import SkinPlan
    from eskin_sensor_node.columns.sensing import Sensed
    from eskin_sensor_node.firmware.taxel.taxel import Taxel
    from eskin_sensor_node.kinds.skin_section import SkinSection
    from eskin_sensor_node.machine.clock import Clock

_SHARED: Final = 1_767_225_600 * BILLION
"""2026-01-01, UTC ns: the scenario's start where several nodes share a skin."""


class Fault(NamedTuple):
    """A taxel that may be broken, by the last window of the self-test.

    Attributes:
        taxel: Its name.
        dead: Whether its line is open: impossible 0, possible 1, certain 2.
        stuck: Whether it keeps one value.
    """

    taxel: str
    dead: int
    stuck: int


class PadColumns:
    """Samples the pads of a skin that one node has; see `SkinColumns`.

    Args:
        section: The skin's settings.
        plan: How it is described.
        seed: Draws true parts and noise; nodes that share a skin may have one seed.
        boot: The node's; it draws the noise.
        clock: The node's.

    Attributes:
        layout: See `SkinColumns`.
        patches: See `SkinColumns`; all of the skin, of which this node may sample a share.
        columns: Names of the taxels that this node samples, in the order of its columns.
        period: From row to row, ns.
        broken: Which columns are certainly broken: they are reported as unknown.
        neighbours: Columns of each column's neighbours: `NO_NEIGHBOUR` where there is none,
            ``len(columns)`` where another node samples it.
        units: UCUM code of each quantity that its patches state.
        coverage: Probability that a sample's interval encloses the truth, at least.
        taxels: See `SkinColumns`.
    """

    def __init__(
        self, section: SkinSection, plan: SkinPlan, *, seed: int, boot: int, clock: Clock
    ) -> None:
        self.layout = plan.layout
        self.patches = plan.patches
        skin, taxel = section.skin, section.taxel
        self._own = [(number, len(plan.tiles[number])) for number in plan.own]
        self._taxels = np.concatenate([plan.tiles[number] for number in plan.own])
        self.columns = [skin.names[number] for number in self._taxels.tolist()]
        self.neighbours = _local(skin.neighbours[self._taxels], self._taxels, len(skin))
        self.units = {patch.quantity: patch.unit for patch in plan.patches}
        self._clock, self._boot = clock, boot
        self._shared = bool(section.controllers)
        self._sensing = SensingColumns(
            taxel,
            seeds=seed,
            numbers=self._taxels,
            companions=section.companions,
            places=self.columns,
        )
        self._inversion = PadColumnsInversion(taxel, section.companions)
        inside = np.where(self.neighbours < len(self.columns), self.neighbours, NO_NEIGHBOUR)
        self._self_test = ColumnsSelfTest(skin.positions[self._taxels], inside)
        self._faults = np.full(len(self.columns), -1)
        self._surround()
        self.coverage = coverage(
            taxel, section.companions, [(taxel, {})] * skin.neighbours.shape[1]
        )
        self._stretch, self._most_rows = section.stretch, section.rows
        self._begin = self._row = 0
        self._section = section
        self._calibrated: dict[int, Taxel] = {}
        self._latest: tuple[tuple[int, int, int], Sensed] | None = None
        self.sample_every(section.period)
        self.taxels = {
            name: ColumnTaxel(self, number, section) for number, name in enumerate(self.columns)
        }

    def calibrated(self, neighbours: int) -> Taxel:
        """The firmware's calibration of a pad among so many neighbours."""
        if neighbours not in self._calibrated:
            taxel = self._section.taxel
            sheet = data_sheet(taxel, self._section.companions)
            self._calibrated[neighbours] = taxel.firmware(sheet, compiled_inversion())
            self._calibrated[neighbours].surround(neighbours)
        return self._calibrated[neighbours]

    @property
    def frame(self) -> Frame:
        """See `SkinColumns`."""
        return Frame(
            self._row, self._begin, 0, self._rows, self.period, self.next_due, closes=False
        )

    @property
    def next_start(self) -> int:
        """See `SkinColumns`."""
        return self._begin

    @property
    def next_due(self) -> int:
        """See `SkinColumns`."""
        return self._begin + self._rows * self.period

    @property
    def broken(self) -> NDArray[np.bool_]:
        """See the class."""
        return np.asarray(self._faults >= 0)

    def sample_every(self, period: int) -> None:
        """Sample with another period, ns, from the next stretch on.

        A stretch is as long as designed, or shorter: its page is planned for so many rows.
        """
        self.period = period
        self._rows = min(max(self._stretch // period, 1), self._most_rows)
        starts = itertools.accumulate((size for _, size in self._own), initial=0)
        # Of each cell of the patches' matrices, one after the other: its place in columns × rows.
        self._places = np.concatenate(
            [
                (np.arange(start, start + size) * self._rows + np.arange(self._rows)[:, None])
                for start, (_, size) in zip(starts, self._own, strict=False)
            ],
            axis=None,
        )

    def advance(self, ticks: int) -> Iterator[SkinStretch]:
        """See `SkinColumns`."""
        while self.next_due <= ticks:
            yield self._sample()

    def skip(self, ticks: int) -> int:
        """See `SkinColumns`."""
        lost = max(0, -((self._begin - ticks) // (self._rows * self.period)))
        self._pass(lost * self._rows)
        return lost * self._rows * len(self.columns)

    def _pass(self, rows: int) -> None:
        self._begin += rows * self.period
        self._row += rows

    def _sample(self) -> SkinStretch:
        """Take the next stretch."""
        begin, rows, first_row = self._begin, self._rows, self._row
        sensed = self.sensed
        self._inversion.measure(sensed.readings[0].codes)
        self._self_test.take(*self._inversion.capacitance)
        self._inversion.separate(self._groups)
        lows, highs = self._inversion.pressure
        broken = self.broken
        if np.any(broken):
            lows[broken], highs[broken] = -np.inf, np.inf
        self._pass(rows)
        grid = Grid(0, self.period, first_row, rows, self.coverage)
        cells = [values.ravel()[self._places] for values in (lows, highs, sensed.truth["pressure"])]
        return SkinStretch(begin, self._begin, (grid,), tuple(self._patches(cells, rows)))

    def _patches(self, cells: list[Floats], rows: int) -> Iterator[PatchColumns]:
        """Each patch's part of the cells, which are ordered as in `_places`."""
        at = 0
        for number, size in self._own:
            lo, hi, truth = (each[at : at + rows * size].reshape(rows, size) for each in cells)
            yield PatchColumns(number, 0, 0, lo, hi, truth)
            at += rows * size

    def sense(self, instants: NDArray[np.int64]) -> Sensed:
        """Codes of all columns at instants on the node's clock, ns, and the truth behind them."""
        return self._sensing.sense(self._boot, instants, self._seconds(instants)[None])

    @property
    def sensed(self) -> Sensed:
        """Codes of the stretch that is not complete, and the truth behind them."""
        key = self._begin, self.period, self._rows
        if self._latest is None or self._latest[0] != key:
            instants = self._begin + self.period * np.arange(self._rows, dtype=np.int64)
            self._latest = key, self.sense(instants)
        return self._latest[1]

    def examine(self) -> list[Fault]:
        """End a window of the self-test; gives the taxels that may be broken.

        A taxel that is certainly broken is reported as unknown, and its neighbours do not trust it,
        until a window shows that it is not.
        """
        found = np.stack(self._self_test.examine())
        for kind in (0, 1):
            certain = (self._faults < 0) & (found[kind] == CERTAIN)
            refuted = (self._faults == kind) & (found[kind] == IMPOSSIBLE)
            self._faults[certain] = kind
            self._faults[refuted] = -1
            # What was certain once, and not refuted since, is certain.
            found[kind, self._faults == kind] = CERTAIN
        self._surround()
        doubtful = np.flatnonzero(np.any(found != IMPOSSIBLE, axis=0)).tolist()
        return [Fault(self.columns[k], int(found[0, k]), int(found[1, k])) for k in doubtful]

    def _surround(self) -> None:
        self._groups = surroundings(self.neighbours, ~self.broken)

    def _seconds(self, instants: NDArray[np.int64]) -> Floats:
        """True seconds since the scenario began."""
        begin = self._clock.true_time(0) - _SHARED if self._shared else self._clock.lived
        return np.asarray((self._clock.elapsed(instants) + begin) / BILLION)


def _local(
    neighbours: NDArray[np.int64], taxels: NDArray[np.int64], total: int
) -> NDArray[np.int64]:
    """The same table in columns; ``len(taxels)`` for those that another node samples."""
    column_of = np.full(total, len(taxels), np.int64)
    column_of[taxels] = np.arange(len(taxels))
    return np.where(neighbours == NO_NEIGHBOUR, NO_NEIGHBOUR, column_of[neighbours])
