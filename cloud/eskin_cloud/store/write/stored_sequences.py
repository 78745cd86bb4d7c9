"""The memory behind *once*: which numbers of a boot are stored, and what is not written yet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from eskin.wire.sequence_set import SequenceRanges

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


MOST_RANGES: Final = 100_000
"""Of a boot: each costs a row for ever, and memory. An honest node leaves a hole where it tells of
a loss, and nowhere else."""


class Change(NamedTuple):
    """A range that changed since it was written.

    Attributes:
        first: Its first number.
        before: Its last as it was written; ``None``: there was none.
        now: Its last now; ``None``: it is a part of another one.
    """

    first: int
    before: int | None
    now: int | None


class StoredSequences(SequenceRanges):
    """Ranges, of which only what changed is written: a node may leave a hole at each second number.

    Args:
        ranges: As they were written.
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
        else:  # most numbers arrive in order
            self._before.setdefault(self._firsts[-1], self._lasts[-1])
        super().add(first, last)

    def has_room_for(self, number: int) -> bool:
        """Whether a number may be added; one that leaves another hole may be one too many."""
        return len(self) < MOST_RANGES or bool(self.near(number, number))

    def changes(self) -> Iterator[Change]:
        """What is to be written."""
        for first, before in self._before.items():
            now = self.last_of(first)
            if now != before:
                yield Change(first, before, now)

    def written(self) -> None:
        """All of it is written now."""
        self._before.clear()
