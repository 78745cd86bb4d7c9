"""Sequence numbers already seen, as few ranges as possible: the memory behind *once*."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class SequenceRanges:
    """A set of integers kept as disjoint, sorted ``(first, last)`` ranges.

    Numbers that arrive in order keep it at one range; a hole costs one range more.
    """

    def __init__(self, ranges: Iterable[tuple[int, int]] = ()) -> None:
        self._firsts: list[int] = []
        self._lasts: list[int] = []
        for first, last in ranges:
            self.add(first, last)

    def __contains__(self, number: int) -> bool:
        if not self._lasts or number > self._lasts[-1]:
            return False
        at = bisect_right(self._firsts, number) - 1
        return at >= 0 and number <= self._lasts[at]

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return zip(self._firsts, self._lasts, strict=True)

    def __len__(self) -> int:
        """How many ranges are kept."""
        return len(self._firsts)

    def near(self, first: int, last: int) -> list[tuple[int, int]]:
        """The ranges that all from ``first`` to ``last`` would melt with."""
        if self._lasts and first == self._lasts[-1] + 1:  # as in `add`
            return [(self._firsts[-1], self._lasts[-1])]
        left = bisect_left(self._lasts, first - 1)
        right = bisect_right(self._firsts, last + 1)
        return list(zip(self._firsts[left:right], self._lasts[left:right], strict=True))

    def last_of(self, first: int) -> int | None:
        """The last number of the range that begins with ``first``; ``None`` if none does."""
        at = bisect_left(self._firsts, first)
        begins = at < len(self._firsts) and self._firsts[at] == first
        return self._lasts[at] if begins else None

    def add(self, first: int, last: int | None = None) -> None:
        """Add one number, or all from ``first`` to ``last``; neighbours melt into one range.

        Raises:
            ValueError: ``first > last``.
        """
        last = first if last is None else last
        if first > last:
            raise ValueError(f"reversed range: {first} > {last}")
        if self._lasts and first == self._lasts[-1] + 1:  # most numbers arrive in order
            self._lasts[-1] = last
            return
        left = bisect_left(self._lasts, first - 1)
        right = bisect_right(self._firsts, last + 1)
        if left < right:
            first = min(first, self._firsts[left])
            last = max(last, self._lasts[right - 1])
        self._firsts[left:right] = [first]
        self._lasts[left:right] = [last]
