"""What is known of a channel, and all the signals that it may be."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import TYPE_CHECKING, TypeAlias

from tests.unit.eskin.monitor.oracle.intervals import ANY, Interval
from tests.unit.eskin.monitor.oracle.traces import Instant, Trace, make

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tests.unit.eskin.monitor.oracle.formulas import Rational


@dataclass(frozen=True)
class Samples:
    """Samples of a channel, in order.

    Attributes:
        earliest: Least instant of each, in nanoseconds.
        latest: Greatest instant of each.
        lo: Least value of each.
        hi: Greatest value of each.
        period: How long a sample holds before a gap, in nanoseconds.
        gap: Whether samples are lost after each.
        until: The next sample comes no earlier; None where nothing is known of it.
        kilo: Whether the library is given the values in thousands of the unit.
    """

    earliest: tuple[int, ...]
    latest: tuple[int, ...]
    lo: tuple[Rational, ...]
    hi: tuple[Rational, ...]
    period: int
    gap: tuple[bool, ...]
    until: int | None = None
    kilo: bool = False

    def __len__(self) -> int:
        return len(self.earliest)

    @property
    def exact_instants(self) -> bool:
        return self.earliest == self.latest

    @cached_property
    def enclosures(self) -> list[tuple[int, int]]:
        """The enclosures that are possible in their order; where one ascends, without its end."""
        least = list(accumulate(self.earliest, max))
        greatest = list(accumulate(reversed(self.latest), min))[::-1]
        return list(zip(least, greatest, strict=True))

    def _may_have_begun(self, k: int, t: Instant) -> bool:
        """Whether a sample's instant may be at an instant, or before it."""
        least = self.enclosures[k][0]
        return t > least or (t == least and (k == 0 or self.enclosures[k - 1][0] < least))

    def sets(self) -> Trace[frozenset[Interval]]:
        """The intervals that may hold at each instant; unknown is the whole line."""
        n = len(self)
        times = {t for pair in self.enclosures for t in pair}
        times |= {t + self.period for t in times}
        if self.until is not None:
            times.add(self.until)

        def value(t: Instant) -> frozenset[Interval]:
            held: set[Interval] = set()
            for k, (least, greatest) in enumerate(self.enclosures):
                following = k + 1 < n
                if not self._may_have_begun(k, t) or (following and t >= self.enclosures[k + 1][1]):
                    continue
                if not self.gap[k] or t < greatest + self.period:
                    held.add((self.lo[k], self.hi[k]))
                if self.gap[k] and self._may_have_begun(k, t - self.period):
                    held.add(ANY)
                if not following and t > least and self._may_have_ended(t):
                    held.add(ANY)
            if not n or t < self.enclosures[0][1]:
                held.add(ANY)
            return frozenset(held)

        return make(times, value)

    def _may_have_ended(self, t: Instant) -> bool:
        """Whether the sample after the last one may have come."""
        return self.until is None or t >= self.until

    def signal(
        self,
        enclosures: Sequence[Instant],
        values: Sequence[Rational],
        elsewhere: Trace[Rational],
    ) -> Trace[Rational]:
        """One possible signal.

        Args:
            enclosures: Of the samples, in order.
            values: Of the samples.
            elsewhere: Where none holds.
        """
        times = {*enclosures, *(t + self.period for t in enclosures), *elsewhere.times}
        if self.until is not None:
            times.add(self.until)

        def value(t: Instant) -> Rational:
            k = bisect_right(enclosures, t) - 1
            if k < 0:
                return elsewhere(t)
            lost = self.gap[k] and t >= enclosures[k] + self.period
            last = k + 1 == len(enclosures)
            pending = last and t > enclosures[k] and self._may_have_ended(t)
            return elsewhere(t) if lost or pending else values[k]

        return make(times, value)


Signals: TypeAlias = "dict[str, Samples]"
World: TypeAlias = "dict[str, Trace[Rational]]"
