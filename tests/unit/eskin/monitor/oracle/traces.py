"""Functions of dense time that change at finitely many instants, and temporal logic on them.

A trace has a value at each of its instants and one on each open interval between them. Every
operator is evaluated from its definition, at the instants where its result can change and at one
instant between any two of them. Instants are whole nanoseconds, or fractions of them.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import isfinite
from typing import TYPE_CHECKING, Generic, TypeAlias, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

T = TypeVar("T")
U = TypeVar("U")
Instant: TypeAlias = int | Fraction


@dataclass(frozen=True)
class Trace(Generic[T]):
    """A function of time.

    Attributes:
        times: Where it may change, ascending.
        at: Its values there.
        between: Its values before the first of them, between any two, and after the last.
    """

    times: tuple[Instant, ...]
    at: tuple[T, ...]
    between: tuple[T, ...]

    def __call__(self, t: Instant) -> T:
        k = bisect_left(self.times, t)
        return self.at[k] if k < len(self.times) and self.times[k] == t else self.between[k]

    def before(self, t: Instant) -> T:
        """The value immediately before an instant."""
        return self.between[bisect_left(self.times, t)]

    def after(self, t: Instant) -> T:
        """The value immediately after an instant."""
        return self.between[bisect_right(self.times, t)]

    def within(self, begin: Instant | float, end: Instant | float) -> Iterator[T]:
        """All values that it takes in a closed window."""
        if begin > end:
            return
        first, last = bisect_left(self.times, begin), bisect_right(self.times, end)
        yield from self.at[first:last]
        if first == last or begin < self.times[first]:
            yield self.between[first]
        yield from self.between[first + 1 : last]
        if first < last and self.times[last - 1] < end:
            yield self.between[last]


def make(times: Iterable[Instant], value: Callable[[Instant], T]) -> Trace[T]:
    """A trace from its value anywhere, given where it may change."""
    asked = sorted(set(times))
    if not asked:
        return Trace((), (), (value(0),))
    middles = (middle(a, b) for a, b in pairwise(asked))
    between = [value(t) for t in (asked[0] - 1, *middles, asked[-1] + 1)]
    return _simplest(asked, [value(t) for t in asked], between)


def combine(function: Callable[..., U], traces: Sequence[Trace[T]]) -> Trace[U]:
    """A function of the values of traces, instant by instant."""
    times = sorted({t for trace in traces for t in trace.times})
    places = [0] * len(traces)
    at = []
    between = [function(*(trace.between[0] for trace in traces))]
    for t in times:
        here = []
        for n, trace in enumerate(traces):
            k = places[n]
            if k < len(trace.times) and trace.times[k] == t:
                here.append(trace.at[k])
                places[n] = k + 1
            else:
                here.append(trace.between[k])
        at.append(function(*here))
        after = (trace.between[k] for trace, k in zip(traces, places, strict=True))
        between.append(function(*after))
    return _simplest(times, at, between)


def _simplest(times: Sequence[Instant], at: Sequence[T], between: Sequence[T]) -> Trace[T]:
    """A trace without the instants where nothing changes."""
    kept = [k for k, here in enumerate(at) if not between[k] == here == between[k + 1]]
    return Trace(
        tuple(times[k] for k in kept),
        tuple(at[k] for k in kept),
        (between[0], *(between[k + 1] for k in kept)),
    )


def middle(a: Instant, b: Instant) -> Instant:
    total = a + b
    return total // 2 if isinstance(total, int) and total % 2 == 0 else Fraction(total) / 2


def shifted(trace: Trace[T], *shifts: float) -> set[Instant]:
    """Where the end of a window, so far from now, meets an instant of a trace."""
    return {t - int(shift) for t in trace.times for shift in shifts if isfinite(shift)}


def some(trace: Trace[bool], begin: float, end: float) -> Trace[bool]:
    """Whether it holds anywhere in ``[t + begin, t + end]``."""
    return make(shifted(trace, begin, end), lambda t: any(trace.within(t + begin, t + end)))


def every(trace: Trace[bool], begin: float, end: float) -> Trace[bool]:
    """Whether it holds everywhere in ``[t + begin, t + end]``."""
    return make(shifted(trace, begin, end), lambda t: all(trace.within(t + begin, t + end)))


def until(left: Trace[bool], right: Trace[bool], begin: float, end: float) -> Trace[bool]:
    """Whether right holds at a t' in ``[t + begin, t + end]``, and left in ``[t, t')``.

    Left holds in ``[t, t')`` if and only if t' is at most the infimum of where it does not.
    """

    def value(t: Instant) -> bool:
        last: Instant | float = t + end
        if not (left(t) and left.after(t)):
            last = min(last, t)
        for k in range(bisect_right(left.times, t), len(left.times)):
            if not (left.at[k] and left.between[k + 1]):
                last = min(last, left.times[k])
                break
        return any(right.within(t + begin, last))

    times = shifted(left, 0, begin, end) | shifted(right, 0, begin, end)
    return make(times, value)


def since(left: Trace[bool], right: Trace[bool], begin: float, end: float) -> Trace[bool]:
    """Whether right holds at a t' in ``[t - end, t - begin]``, and left in ``(t', t]``."""
    return reversed_in_time(until(reversed_in_time(left), reversed_in_time(right), begin, end))


def reversed_in_time(trace: Trace[T]) -> Trace[T]:
    """The trace in which the future is the past."""
    return Trace(tuple(-t for t in reversed(trace.times)), trace.at[::-1], trace.between[::-1])
