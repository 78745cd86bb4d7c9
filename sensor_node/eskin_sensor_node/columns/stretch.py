"""What a skin measured in one stretch of time, patch by patch."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from eskin.interval import Floats
    from eskin.wire.frames import Grid, Layout, Patch
    from eskin_sensor_node.columns.taxel import ColumnTaxel
    from eskin_sensor_node.firmware.schedule import Frame


class PatchColumns(NamedTuple):
    """Samples of one patch in a stretch, with the truth behind them.

    Attributes:
        patch: Its number in the layout.
        grid: Number of its grid in the stretch.
        epoch: Of shared errors; 0 where samples share none.
        lo: Lower bounds, shape ``(rows, columns)``, in the patch's unit; infinite where unknown.
        hi: Upper bounds.
        truth: The true values at the true instants.
    """

    patch: int
    grid: int
    epoch: int
    lo: Floats
    hi: Floats
    truth: Floats


class SkinStretch(NamedTuple):
    """A stretch of time of a whole skin.

    Attributes:
        begin: The node's clock at the first instant, ns since its start.
        end: The same when the last sample is complete.
        grids: When patches were sampled.
        patches: In the order of the layout.
    """

    begin: int
    end: int
    grids: Sequence[Grid]
    patches: Sequence[PatchColumns]


class SkinColumns(Protocol):
    """The taxels of a skin, sampled together."""

    @property
    def layout(self) -> Layout:
        """By which its frames are read."""
        ...

    @property
    def patches(self) -> Sequence[Patch]:
        """The descriptions that the layout names, in its order."""
        ...

    @property
    def period(self) -> int:
        """From row to row, ns."""
        ...

    @property
    def frame(self) -> Frame:
        """When the samples of the stretch that is not complete are taken."""
        ...

    @property
    def taxels(self) -> Mapping[str, ColumnTaxel]:
        """Those that the node samples, by their names; monitors read them one by one."""
        ...

    @property
    def next_start(self) -> int:
        """The node's clock when the next stretch begins, ns."""
        ...

    @property
    def next_due(self) -> int:
        """The node's clock when the next stretch is complete, ns."""
        ...

    def sample_every(self, period: int) -> None:
        """Sample with another period, ns, from the next stretch on; no stretch becomes longer."""
        ...

    def examine(self) -> Sequence[tuple[str, int, int]]:
        """End a window of the self-test.

        A taxel that is certainly broken is reported as unknown until a window refutes it.

        Returns:
            Taxels that may be broken: name, whether it is dead, whether it is stuck, each as a
            number of `eskin.interval.Verdict`.
        """
        ...

    def advance(self, ticks: int) -> Iterator[SkinStretch]:
        """Take all stretches that are complete by an instant."""
        ...

    def skip(self, ticks: int) -> int:
        """Drop all stretches that begin before an instant; gives how many samples are lost."""
        ...
