"""The stored sequence numbers of a boot, and the changes that are not written yet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.wire.sequence_set import SequenceRanges

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


MAX_RANGES: Final = 100_000
"""Of a boot: each range costs a row and memory. Honest nodes skip numbers only for losses."""


class RangeChange(NamedTuple):
    """A range that changed since the last write.

    Attributes:
        first: Its first number.
        before: Its last number as written; ``None`` for a new range.
        now: Its last number now; ``None`` if it was merged into another range.
    """

    first: int
    before: int | None
    now: int | None


class StoredSequences(SequenceRanges):
    """Ranges that record their changes, so that a save writes only these.

    Args:
        ranges: The stored ranges.
    """

    def __init__(self, ranges: Iterable[tuple[int, int]] = ()) -> None:
        self._before: dict[int, int | None] = {}
        super().__init__(ranges)
        self._before.clear()

    def add(self, first: int, last: int | None = None) -> None:
        """Add one number, or all from ``first`` to ``last``.

        Raises:
            ValueError: ``first > last``.
        """
        if not self._lasts or first != self._lasts[-1] + 1:
            for known in self.near(first, first if last is None else last):
                self._before.setdefault(*known)
            self._before.setdefault(first, None)
        else:  # the usual case: numbers arrive in order
            self._before.setdefault(self._firsts[-1], self._lasts[-1])
        super().add(first, last)

    def has_room_for(self, number: int) -> bool:
        """Whether a number may be added without exceeding `MAX_RANGES`."""
        return len(self) < MAX_RANGES or bool(self.near(number, number))

    def changes(self) -> Iterator[RangeChange]:
        """The changes to write."""
        for first, before in self._before.items():
            now = self.last_of(first)
            if now != before:
                yield RangeChange(first, before, now)

    def written(self) -> None:
        """Forget the changes, which are written."""
        self._before.clear()
