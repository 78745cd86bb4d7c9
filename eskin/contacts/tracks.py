"""What is known of contacts over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.contacts.contacts import Rows
from eskin.interval import Verdict
from eskin.interval.markup import html_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

BEFORE_ALL: Final = int(np.iinfo(np.int64).min)
"""In a table, the time of a begin that has no lower bound."""
AFTER_ALL: Final = int(np.iinfo(np.int64).max)
"""In a table, the time of an end that has no upper bound."""
TRACK: Final = np.dtype(
    [
        (name, np.int64)
        for name in (
            "id", "verdict", "first", "last", "begin_inf", "begin_sup", "end_inf", "end_sup",
        )
    ]
)  # fmt: skip
"""One row of `ContactTracks.table`; the columns are explained at `ContactTrack`."""
INSTANT: Final = np.dtype(
    [(name, np.int64) for name in ("sample", "cores", "possible", "fewest", "most")]
    + [("exact", np.bool_)]
)
"""One row of `ContactTracks.instants`."""


@dataclass(frozen=True, slots=True)
class ContactTrack:
    """A contact over time, under one label.

    A contact of one instant goes on in those of the next with which it shares a taxel. It has
    begun at the first instant that such a chain, back from its first core, reaches, and ended after
    the last instant that such a chain, on from its last core, reaches. A contact that splits off
    has begun with the one that it was part of, and one that merges into another ends with that one.

    Attributes:
        id: The label. It is given by a fixed rule (see `ContactStream`) and states nothing.
        verdict: Whether all instants under this label are of one chain: certain, or possible.
        first: First sample at which it has a core.
        last: Last sample at which it has a core.
        begin: Enclosure of its begin, UTC ns: from the last instant at which it was impossible to
            the first at which it is certain; the first is ``None`` if there is no such instant.
        end: Enclosure of its end, UTC ns: from the last instant at which it is certain to the
            first at which it is impossible; the second is ``None`` if there is no such instant.
    """

    id: int
    verdict: Verdict
    first: int
    last: int
    begin: tuple[int | None, int]
    end: tuple[int, int | None]


class ContactTracks(Rows[ContactTrack]):
    """Contacts over time: a sequence of `ContactTrack`.

    Attributes:
        table: One row for each track: ``id``, ``verdict``, ``first``, ``last``, ``begin_inf``,
            ``begin_sup``, ``end_inf``, ``end_sup`` (see `ContactTrack`). A begin without a lower
            bound is the least int64, an end without an upper bound the greatest.
        cores: One row for each core of each instant: ``sample``, ``track`` (its label), and the
            columns of `Contacts.table`.
        instants: One row for each instant: ``sample``, ``cores``, ``possible`` (regions without a
            core), ``fewest`` and ``most`` contacts, ``exact`` (see `Region`).
    """

    __slots__ = ("cores", "instants")

    def __init__(
        self, table: NDArray[np.void], cores: NDArray[np.void], instants: NDArray[np.void]
    ) -> None:
        self.table = table
        self.cores = cores
        self.instants = instants

    def __repr__(self) -> str:
        return f"ContactTracks({len(self)} tracks, {len(self.instants)} instants)"

    def _repr_html_(self) -> str:
        def row(k: int) -> list[str]:
            each = self[k]
            bounds = [*each.begin, *each.end]
            times = ["" if bound is None else str(np.datetime64(bound, "ns")) for bound in bounds]
            return [str(each.id), each.verdict.name.lower(), *times]

        heads = ["track", "one contact", "begins after", "before", "ends after", "before"]
        caption = f"{len(self)} tracks in {len(self.instants)} instants"
        return html_table(caption, heads, len(self), row)

    def _row(self, _: int, /, *columns: Any) -> ContactTrack:
        label, verdict, first, last, begin_inf, begin_sup, end_inf, end_sup = columns
        return ContactTrack(
            label,
            Verdict(verdict),
            first,
            last,
            (None if begin_inf == BEFORE_ALL else begin_inf, begin_sup),
            (end_inf, None if end_sup == AFTER_ALL else end_sup),
        )
