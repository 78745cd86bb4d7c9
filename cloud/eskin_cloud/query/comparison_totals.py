"""For how long and how often one channel is above another: each told as an interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eskin_cloud.query.occupancy import Entries
from eskin_cloud.query.predicate import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin_cloud.query.comparison_segments import ComparisonSegment


@dataclass(frozen=True, slots=True)
class ComparisonTotals:
    """What is known of a comparison over a window.

    Attributes:
        time: ns above, at least and at most, while both are known.
        unknown: ns in which one of both is not.
        entries: How often it came to be above; what goes on behind a gap begins anew.
        samples: Samples of both that this rests on, at most.
    """

    time: tuple[int, int]
    unknown: int
    entries: tuple[int, int]
    samples: int


def sum_up_stretches(stretches: Iterable[ComparisonSegment]) -> ComparisonTotals:
    """Sum up stretches that are merged, and in order of time."""
    spent, unknown, samples, entries = [0, 0, 0], 0, 0, Entries()
    for stretch in stretches:
        if stretch.answer is None:
            unknown += stretch.end - stretch.start
            entries.part()
        else:
            spent[stretch.answer] += stretch.end - stretch.start
            entries.add(stretch.answer, stretch.slots)
        samples += stretch.samples
    entries.part()
    sure = spent[Verdict.CERTAIN]
    return ComparisonTotals(
        (sure, sure + spent[Verdict.POSSIBLE]), unknown, (entries.least, entries.most), samples
    )
