"""The search for peaks of a tube that arrives in pieces, compiled."""

from __future__ import annotations

from math import inf, nan
from typing import TYPE_CHECKING, Final, TypeGuard, overload

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Interval
from eskin.interval.conversion import as_compiled, enclose
from eskin.kernels.rounding_mode import rounding_to_nearest
from eskin.peaks.certain_possible_peaks import MOST_AT_ONCE, PROGRESS, search
from eskin.peaks.event import no_interval, require_prominence
from eskin.peaks.hysteresis import NONE, PASS
from eskin.peaks.region import MOST_REGIONS, REGION
from eskin.peaks.table import EVENT, Peaks
from eskin.tube import Tube

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.interval import Floats

_FOREVER: Final = 2**62
_MOST_ROOM: Final = 2**20
_KEPT_ROOM: Final = 2**10
_NO_EVENTS: Final = np.empty(0, EVENT)
_MISSING: Final = np.array([nan])
_NOWHERE: Final = (NONE, 0, inf, -inf, inf, -inf, -inf)


class PeakStream:
    """Finds the peaks of a tube that arrives in pieces, in constant memory.

    Args:
        prominence: Least prominence p > 0, in the signal's unit.
        longest_region: Samples after which undecided regions are reported as possible; ``None``
            waits for the end. The search goes on: a peak reported like this may still prove
            certain and is reported again then, so that the number of certain ones stays exact and
            the number of possible ones an upper bound.

    Raises:
        ValueError: The prominence is not positive and finite.
        IntervalError: The prominence carries a unit.
    """

    def __init__(self, prominence: float, *, longest_region: int | None = None) -> None:
        require_prominence(prominence)
        self._prominence = float(prominence)
        longest = _FOREVER if longest_region is None else longest_region
        self._state = (
            np.array([(0, 0, longest)], PROGRESS),
            np.array([_NOWHERE, _NOWHERE], PASS),
            np.zeros(MOST_REGIONS + 1, REGION),
        )
        self._room = np.empty(_KEPT_ROOM, EVENT)  # for short blocks: making it costs as they do

    @overload
    def feed(self, samples: Tube | Interval) -> Peaks: ...
    @overload
    def feed(self, samples: ArrayLike, highs: ArrayLike) -> Peaks: ...
    def feed(self, samples: Tube | Interval | ArrayLike, highs: ArrayLike | None = None) -> Peaks:
        """Take the next samples, in order.

        Args:
            samples: A tube, an interval of shape ``(n,)``, or n lower bounds: ``-inf`` where
                unbounded, NaN where a sample is missing (a gap).
            highs: n upper bounds to the lower ones: ``inf`` where unbounded, NaN where missing.

        Returns:
            What is decided now, in order of its end. Indices count all samples since the start,
            over gaps too.

        Raises:
            IntervalError: Bounds are no interval, or differ in number. The search stands before
                them, and what this call found is lost.
        """
        return self._search(*_samples_of(samples, highs))

    def gap(self, samples: int = 0) -> Peaks:
        """Say that ``samples`` samples are missing here; nothing is joined across."""
        peaks = self._search(_MISSING, _MISSING)
        self._state[0]["index"] += samples - 1
        return peaks

    def finish(self) -> Peaks:
        """Say that the signal ends; what is undecided is possible."""
        return self.gap()

    @rounding_to_nearest
    def _search(self, lows: Floats, highs: Floats) -> Peaks:
        need = min(lows.size // 2, _MOST_ROOM) + 2 * MOST_AT_ONCE
        events = self._room if need <= _KEPT_ROOM else np.empty(need, EVENT)
        taken, count = search(lows, highs, self._prominence, *self._state, events)
        while taken < lows.size:
            if count + MOST_AT_ONCE <= events.size:
                index = int(self._state[0]["index"][0])
                raise no_interval(index, float(lows[taken]), float(highs[taken]))
            events = np.concatenate([events, np.empty_like(events)])
            more, found = search(
                lows[taken:], highs[taken:], self._prominence, *self._state, events[count:]
            )
            taken, count = taken + more, count + found
        if count == 0:
            return Peaks(_NO_EVENTS)
        shared = events is self._room or 2 * count <= events.size
        return Peaks(events[:count].copy() if shared else events[:count])


@overload
def find_peaks(samples: Tube | Interval, *, prominence: float) -> Peaks: ...
@overload
def find_peaks(samples: ArrayLike, highs: ArrayLike, *, prominence: float) -> Peaks: ...
def find_peaks(
    samples: Tube | Interval | ArrayLike, highs: ArrayLike | None = None, *, prominence: float
) -> Peaks:
    """All peaks of a whole tube, certain and possible, in order of their end.

    What counts as a peak where heights are equal stands in `eskin.peaks`; there scipy's function of
    this name counts others.

    Args:
        samples: A tube, an interval of shape ``(n,)``, or n lower bounds: ``-inf`` where unbounded,
            NaN where a sample is missing (a gap).
        highs: n upper bounds to the lower ones: ``inf`` where unbounded, NaN where missing.
        prominence: Least prominence p > 0, in the signal's unit.

    Returns:
        The events; `Peaks.table` is their fast form.

    Raises:
        ValueError: The prominence is not positive and finite.
        IntervalError: Bounds are no interval, or differ in number, or a value carries a unit.
    """
    stream = PeakStream(prominence)
    found = stream.feed(*_samples_of(samples, highs))
    undecided = stream.finish()
    return Peaks(np.concatenate([found.table, undecided.table])) if undecided else found


def _samples_of(
    samples: Tube | Interval | ArrayLike, highs: ArrayLike | None
) -> tuple[Floats, Floats]:
    """Lower and upper bounds, contiguous, of one axis.

    Raises:
        IntervalError: They are none, or differ in number.
    """
    if _is_plain(samples) and _is_plain(highs) and samples.shape == highs.shape:
        return samples, highs
    if isinstance(samples, Tube):
        samples = samples.values
    if isinstance(samples, Interval):
        if highs is not None:
            raise IntervalError(
                "a tube or an interval has its upper bounds already; leave highs out"
            )
        lo, hi = samples.inf, samples.sup
    elif highs is None:
        raise IntervalError(
            "lower bounds need upper bounds; where a signal is exact, give it for both"
        )
    else:
        lo, hi = enclose(samples, "lows")[0], enclose(highs, "highs")[1]
    if lo.ndim != 1 or lo.shape != hi.shape:
        raise IntervalError(
            f"lows and highs need one axis and the same length, not {lo.shape} and {hi.shape}"
        )
    return as_compiled(lo), as_compiled(hi)


def _is_plain(bounds: object) -> TypeGuard[Floats]:
    """Whether these are bounds as they should be: short blocks cannot wait for all other checks."""
    return (
        type(bounds) is np.ndarray
        and bounds.dtype == np.float64
        and bounds.ndim == 1
        and bounds.flags.c_contiguous
        and bounds.flags.carray
    )
