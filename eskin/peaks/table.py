"""Many events as a table: what a kernel fills, and what objects are made from when asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, overload

import numpy as np

from eskin.interval import Interval, Verdict
from eskin.interval.markup import html_table
from eskin.peaks.event import PeakEvent

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

EVENT: Final = np.dtype(
    [
        ("verdict", np.int64),
        ("first", np.int64),
        ("last", np.int64),
        ("fewest", np.int64),
        ("most", np.int64),
        ("height_inf", np.float64),
        ("height_sup", np.float64),
        ("prominence_inf", np.float64),
        ("prominence_sup", np.float64),
    ]
)
"""One row of `Peaks.table`; the columns are the attributes of `PeakEvent`."""


class Peaks(Sequence[PeakEvent]):
    """Events in order: a sequence of `PeakEvent`, kept as one structured array.

    A million samples of noise have 300,000 peaks. As objects they would cost ten times or more what
    finding them costs, so an object is made only when it is asked for; `table` gives them all at
    once.

    Attributes:
        table: One row for each event, with the columns ``verdict``, ``first``, ``last``,
            ``fewest``, ``most``, ``height_inf``, ``height_sup``, ``prominence_inf``,
            ``prominence_sup`` (see `PeakEvent`).
    """

    __slots__ = ("table",)
    __hash__ = None  # type: ignore[assignment]  # the table can change

    def __init__(self, table: NDArray[np.void]) -> None:
        self.table = table

    def __len__(self) -> int:
        return len(self.table)

    @overload
    def __getitem__(self, index: int) -> PeakEvent: ...
    @overload
    def __getitem__(self, index: slice) -> Peaks: ...
    def __getitem__(self, index: int | slice) -> PeakEvent | Peaks:
        if isinstance(index, slice):
            return Peaks(self.table[index])
        return _event(*self.table[index].item())

    def __iter__(self) -> Iterator[PeakEvent]:
        return (_event(*row) for row in self.table.tolist())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Peaks):
            return NotImplemented
        return np.array_equal(self.table, other.table)

    def __repr__(self) -> str:
        return f"Peaks({len(self.certain)} certain, {len(self.possible)} possible)"

    def _repr_html_(self) -> str:
        fewest, most = self.total

        def row(k: int) -> list[str]:
            each = self[k]
            count = (
                "1" if each.verdict is Verdict.CERTAIN else f"{each.count[0]} to {each.count[1]}"
            )
            bounds = [str(Interval(*each.height)), str(Interval(*each.prominence))]
            return [each.verdict.name.lower(), str(each.first), str(each.last), count, *bounds]

        heads = ["verdict", "first", "last", "peaks", "height", "prominence"]
        return html_table(f"{fewest} to {most} peaks", heads, len(self), row)

    @property
    def certain(self) -> Peaks:
        """The certain ones."""
        return Peaks(self.table[self.table["verdict"] == Verdict.CERTAIN])

    @property
    def possible(self) -> Peaks:
        """The regions with possible ones."""
        return Peaks(self.table[self.table["verdict"] == Verdict.POSSIBLE])

    @property
    def total(self) -> tuple[int, int]:
        """Fewest and most peaks that a signal inside the tube has."""
        return int(self.table["fewest"].sum()), int(self.table["most"].sum())


def _event(verdict: int, first: int, last: int, fewest: int, most: int, *bounds: Any) -> PeakEvent:
    return PeakEvent(Verdict(verdict), first, last, (fewest, most), bounds[:2], bounds[2:])
