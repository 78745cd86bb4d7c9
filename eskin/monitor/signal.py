"""What a monitor reads: samples that are held until the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from eskin.errors import MonitorError
from eskin.interval import Interval
from eskin.monitor.formula import MAX_BOUND
from eskin.monitor.runs import END, Runs

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from eskin.monitor.runs import Ticks
    from eskin.monitor.shared import SharedError
    from eskin.tube import Tube

MAX_INSTANT: Final = 2**62 - 2**60
"""ns since 1970, of either sign: the year 2079."""


@dataclass(frozen=True, eq=False)
class Signal:
    """Interval samples at uncertain instants, each held until the next one.

    The value is x_k in ``[lo[k], hi[k]]`` from the instant t_k in ``[earliest[k], latest[k]]``
    until the next instant. Instants ascend strictly. Before a gap x_k is held for one period.
    Elsewhere any value is possible: before the first sample, in the rest of a gap, and after the
    instant of the last sample.

    Args:
        earliest, latest: Whole ns, int64, shape ``(n,)``.
        lo, hi: Bounds in ``unit``, float64; ``-inf``, ``inf`` where a side is unbounded.
        period: Sampling period in ns, of all samples or of each.
        gap: True where a gap follows the sample; by default nowhere.
        unit: UCUM code.
        coverage: Probability with which each sample's interval encloses the truth.
        until: The next sample is not earlier, in ns; the last one is held until then, or, before a
            gap, for one period of that time.
        shared: Errors that the samples share; ``None`` for none.

    Raises:
        MonitorError: The parts do not fit each other, or instants are out of order.
        IntervalError: Bounds are no intervals.
    """

    earliest: NDArray[np.int64]
    latest: NDArray[np.int64]
    lo: NDArray[np.float64]
    hi: NDArray[np.float64]
    period: NDArray[np.int64]
    gap: NDArray[np.bool_]
    unit: str
    coverage: float
    until: int | None
    shared: SharedError | None

    def __init__(  # noqa: PLR0913 - the columns of a signal
        self,
        earliest: ArrayLike,
        latest: ArrayLike,
        lo: ArrayLike,
        hi: ArrayLike,
        period: ArrayLike,
        gap: ArrayLike | None = None,
        *,
        unit: str = "1",
        coverage: float = 1.0,
        until: int | None = None,
        shared: SharedError | None = None,
    ) -> None:
        values = Interval(lo, hi)
        shape = values.shape
        if len(shape) != 1:
            raise MonitorError(f"a signal has one axis, not shape {shape}", value=shape)
        set_ = object.__setattr__
        set_(self, "earliest", _whole(earliest, "earliest", shape))
        set_(self, "latest", _whole(latest, "latest", shape))
        set_(self, "lo", values.inf)
        set_(self, "hi", values.sup)
        set_(self, "period", _whole(period, "period", shape))
        marks = np.zeros(shape, bool) if gap is None else np.asarray(gap)
        if marks.dtype != np.bool_ or marks.shape != shape:
            raise MonitorError(f"gap must be {shape} booleans, not {marks.dtype} {marks.shape}")
        set_(self, "gap", marks)
        set_(self, "unit", unit)
        if not 0.0 <= coverage <= 1.0:
            raise MonitorError(f"coverage must lie in [0, 1], not {coverage}", value=coverage)
        set_(self, "coverage", float(coverage))
        set_(self, "until", until)
        set_(self, "shared", shared)
        if shared is not None and shared.epoch.shape not in ((), shape):
            raise MonitorError(f"epochs have shape {shared.epoch.shape}, the bounds have {shape}")
        if np.any(self.period <= 0) or np.any(self.period > MAX_BOUND):
            raise MonitorError(f"period must lie in [1, {MAX_BOUND}] ns; see {self.period}")
        if until is not None and abs(until) > MAX_INSTANT:
            raise MonitorError(f"until must be an instant in ns, not {until}", value=until)

    def __len__(self) -> int:
        return self.lo.size

    @classmethod
    def from_tube(cls, tube: Tube) -> Self:
        """The signal of a tube; its missing samples (unbounded on both sides) are gaps."""
        lo, hi = tube.values.inf, tube.values.sup
        tube.values.require(lo <= hi, "an empty sample has no value")
        known = np.isfinite(lo) | np.isfinite(hi)
        kept = np.flatnonzero(known)
        moved = kept * np.int64(tube.dt)
        gap = np.append(~known[1:], False)[kept]
        return cls(
            tube.time[0] + moved,
            tube.time[1] + moved,
            lo[kept],
            hi[kept],
            tube.dt,
            gap,
            unit=tube.unit,
            coverage=tube.coverage,
        )


@dataclass(frozen=True)
class HeldSamples:
    """When each sample of a signal may be the one that holds, in ticks.

    Attributes:
        first, last: The run of ticks of each sample in ``index``, both ascending.
        index: Which sample of the signal.
        gaps: Ticks that may lie before the first sample or in a gap.
        pending: Ticks that a later sample may decide.
        frontier: No later sample can change what is before this tick.
    """

    first: Ticks
    last: Ticks
    index: NDArray[np.int64]
    gaps: Runs
    pending: Runs
    frontier: int


def held_samples(signal: Signal) -> HeldSamples:
    """The ticks of each sample, with the instants narrowed by their order.

    Raises:
        MonitorError: No instants in the enclosures keep the order.
    """
    n = len(signal)
    until = signal.until
    if n == 0:
        known = -END if until is None else 2 * until
        gaps = Runs.between(-END, known - 1) if until is not None else Runs.between(0, -1)
        empty = np.empty(0, np.int64)
        return HeldSamples(empty, empty, empty, gaps, Runs.between(known, END), known)
    earliest = np.maximum.accumulate(signal.earliest)
    latest = np.minimum.accumulate(signal.latest[::-1])[::-1]
    after = np.append(False, earliest[1:] == earliest[:-1])  # strictly after the earliest instant
    reversed_ = (earliest > latest) | (after & (earliest == latest))
    if np.any(reversed_):
        k = int(np.argmax(reversed_))
        raise MonitorError(
            f"sample {k} in [{signal.earliest[k]}, {signal.latest[k]}] ns cannot lie between the "
            "one before it and the one after it; sort the samples",
            value=k,
        )
    # A later sample comes after the last one, so nothing at the earliest instant of that is open.
    frontier = max(2 * int(earliest[-1]) + 1, -END if until is None else 2 * until)
    ended = np.where(signal.gap, 2 * (latest + signal.period), END)
    last = np.minimum(ended, np.append(2 * latest[1:], END)) - 1
    last[-1] = min(int(last[-1]), max(2 * int(latest[-1]), frontier - 1))
    first = 2 * earliest + after
    gap_first = np.append(-END, (first + 2 * signal.period)[signal.gap])
    gap_last = np.append(2 * latest[0], np.append(2 * latest[1:], frontier)[signal.gap]) - 1
    kept = first <= last
    return HeldSamples(
        first[kept],
        last[kept],
        np.flatnonzero(kept),
        Runs.of(gap_first, gap_last),
        Runs.between(frontier, END),
        frontier,
    )


def _whole(value: ArrayLike, name: str, shape: tuple[int, ...]) -> NDArray[np.int64]:
    given = np.asarray(value)
    if given.size == 0:
        given = given.astype(np.int64)
    if given.dtype.kind not in "iu":
        raise MonitorError(f"{name} must be whole ns, not {given.dtype}; round outward first")
    try:
        made = np.broadcast_to(given.astype(np.int64), shape)
    except ValueError:
        raise MonitorError(f"{name} has shape {given.shape}, the bounds have {shape}") from None
    if made.size and (int(given.max()) > MAX_INSTANT or int(given.min()) < -MAX_INSTANT):
        raise MonitorError(f"{name} must lie within {MAX_INSTANT} ns of 1970")
    return made
