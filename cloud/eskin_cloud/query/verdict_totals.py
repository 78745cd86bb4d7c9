"""For how long a formula holds over a window, and how often: intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eskin.interval import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable

    from eskin_cloud.query.stored_verdicts import StoredPiece


@dataclass(frozen=True, slots=True)
class VerdictTotals:
    """Totals of a formula over a window.

    Attributes:
        time: Least and greatest time in which it holds, ns, as far as samples exist.
        unknown: Time in which it could hold by samples alone that do not exist, ns.
        entries: Least and greatest number of stretches in which it holds, without those in which
            missing samples may change it.
    """

    time: tuple[int, int]
    unknown: int
    entries: tuple[int, int]


def total_verdicts(pieces: Iterable[StoredPiece]) -> VerdictTotals:
    """Total the verdicts of a window, in order of time."""
    spent, unknown, count = [0, 0, 0], 0, EntryCount()
    for piece in pieces:
        length = (piece.last + 1) // 2 - piece.first // 2
        if piece.missing:
            unknown += length
        else:
            spent[piece.verdict] += length
        if piece.verdict is not Verdict.POSSIBLE:
            count.decided(piece.verdict is Verdict.CERTAIN)
        elif piece.missing or piece.changes is None:
            count.cut()
        else:
            count.open(piece.changes)
    least, most = count.total()
    certain = spent[Verdict.CERTAIN]
    return VerdictTotals((certain, certain + spent[Verdict.POSSIBLE]), unknown, (least, most))


class EntryCount:
    """Counts in how many stretches a formula holds, at least and at most.

    Between two decided stretches that differ it changes at least once, and at most as often as the
    open stretches between them allow; the parity of changes follows from what is decided. Before
    and after a stretch without samples it counts as not holding.
    """

    def __init__(self) -> None:
        self._least = self._most = 0
        self._holds, self._changes, self._empty = False, 1, True

    def decided(self, holds: bool) -> None:  # noqa: FBT001 - the verdict
        """Add a stretch in which it holds, or does not."""
        differs = holds is not self._holds
        changes = max(self._changes, int(differs))
        changes -= (changes % 2 == 1) is not differs
        self._least += holds and differs
        # Changes alternate, so every second one begins a stretch: the first one if it did not hold.
        self._most += (changes + (not self._holds)) // 2
        self._holds, self._changes, self._empty = holds, 0, False

    def open(self, changes: int) -> None:
        """Add a stretch in which it is possible, and changes at most so often, ends included."""
        self._changes += changes
        self._empty = False

    def total(self) -> tuple[int, int]:
        """The least and the greatest number."""
        self.cut()
        return self._least, self._most

    def cut(self) -> None:
        """Leave out a stretch in which missing samples may change it without a bound."""
        if not self._empty:
            self._changes += 1
            self.decided(holds=False)
        self._holds, self._changes, self._empty = False, 1, True
