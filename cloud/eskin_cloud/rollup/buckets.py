"""Consecutive stretches of time of equal width."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eskin.wire.timestamp import MOST_INSTANT
from eskin_cloud.store.read.window import Window

if TYPE_CHECKING:
    from eskin_cloud.rollup.aggregates import Integers


@dataclass(frozen=True, slots=True)
class Buckets:
    """Consecutive buckets of equal width.

    Attributes:
        start: Start of the first, UTC ns.
        width: Width of each, ns.
        count: Number of buckets.
    """

    start: int
    width: int
    count: int

    def of(self, instants: Integers) -> Integers:
        """The numbers of the buckets that hold some times."""
        return (instants - self.start) // self.width

    @property
    def window(self) -> Window:
        """The window of all buckets, limited to 64-bit times."""
        return Window(self.start, min(self.start + self.width * self.count, MOST_INSTANT))
