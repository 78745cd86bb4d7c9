"""A drifting parameter from many constraints, online and for a whole record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import IdentificationError
from eskin.identification.relaxed import as_intervals, find_drifted_hulls
from eskin.interval import Interval
from eskin.kernels.rounding_mode import rounding_to_nearest

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from eskin.interval import Floats

    Bounds = Interval | ArrayLike
    Integers = NDArray[np.int64]

_BILLION: Final = 10**9
_MINUTE: Final = 60 * _BILLION
_WEEK: Final = 7 * 24 * 60
"""Constraints of a week, one a minute."""
_LONGEST: Final = 2**62
"""Times in ns lie below it: differences of two are int64."""


class SetMembershipEstimator:
    """Encloses a positive parameter that drifts, from constraints that arrive one by one.

    The first constraint of each minute of time is kept. This choice does not look at values, so
    that a kept constraint holds with the same probability as any: the tightest one would have the
    union bound of all constraints of its minute. Of the kept ones the last ``memory`` count, with
    32 bytes each.

    Args:
        drift: Bounds of the rate ``d ln p/dt`` in 1/s, for all time.
        outliers: q: so many of the constraints that count may be wrong.
        memory: How many constraints count, the last ones.

    Raises:
        IdentificationError: The drift is not bounded, ``outliers`` is negative, or ``memory`` is
            not greater.
    """

    def __init__(self, drift: Bounds, *, outliers: int, memory: int = _WEEK) -> None:
        self._rates = _rates_of(drift)
        self._outliers, self._memory = _require_sizes(outliers, memory)
        self._instants = np.empty((2, memory), np.int64)
        self._bounds = np.empty((2, memory))
        self._count = 0
        self._last = -_LONGEST
        self._minute = -_LONGEST

    def __len__(self) -> int:
        return min(self._count, self._memory)

    def push(self, earliest: int, latest: int, constraint: Interval) -> None:
        """Take a constraint.

        Args:
            earliest: Earliest instant at which it holds, in ns.
            latest: Latest one.
            constraint: Bounds of the parameter, one interval; what says nothing (no lower bound
                above 0 and no upper one) is left out.

        Raises:
            IdentificationError: Instants are reversed, or the latest one runs backwards, or the
                constraint has no positive member. The estimator stays as it was.
        """
        if constraint.ndim != 0:
            raise IdentificationError(f"a constraint is one interval, not {constraint.shape}")
        instants, bounds = _constraints_of([earliest], [latest], constraint.reshape(1))
        if instants[1, 0] < self._last:
            raise IdentificationError(
                f"latest instant {latest} lies before the one before, {self._last}; "
                "push constraints in order"
            )
        self._last = int(instants[1, 0])
        minute = self._last // _MINUTE
        if np.any(np.isfinite(bounds)) and minute != self._minute:
            place = self._count % self._memory
            self._instants[:, place], self._bounds[:, place] = instants[:, 0], bounds[:, 0]
            self._count, self._minute = self._count + 1, minute

    def at(self, time: int) -> Interval:
        """The parameter at a time in ns, not before an instant of what was pushed.

        Returns:
            Within ``[0, inf]``; empty where no value lies in all constraints but ``outliers``: then
            more of them are wrong, or the parameter drifts faster.

        Raises:
            IdentificationError: The time lies before the latest instant that was pushed.
        """
        n = len(self)
        return _enclosures(
            self._instants[:, :n],
            self._bounds[:, :n],
            np.array([n]),
            _times_of([time], self._last),
            self._rates,
            self._outliers,
            self._memory,
        )[0]


def estimate(
    earliest: ArrayLike,
    latest: ArrayLike,
    constraints: Interval,
    times: ArrayLike,
    drift: Bounds,
    *,
    outliers: int,
    memory: int = _WEEK,
) -> Interval:
    """Enclose a parameter over a whole record: what `SetMembershipEstimator` gives at some times.

    Args:
        earliest: Earliest instant of each of n constraints, in ns.
        latest: Its latest instant, ascending.
        constraints: Bounds of the parameter, (n,).
        times: When the parameter is asked for, in ns, ascending, (m,); constraints count whose
            latest instant is not later.
        drift: Bounds of the rate ``d ln p/dt`` in 1/s, for all time.
        outliers: q: so many of the constraints that count may be wrong.
        memory: How many constraints count, the last ones.

    Returns:
        The parameter at the times, (m,).

    Raises:
        IdentificationError: As `SetMembershipEstimator` has it; or times do not ascend.
    """
    rates, sizes = _rates_of(drift), _require_sizes(outliers, memory)
    instants, bounds = _constraints_of(earliest, latest, constraints)
    asked = _times_of(times, -_LONGEST)
    if np.any(np.diff(instants[1]) < 0) or np.any(np.diff(asked) < 0):
        raise IdentificationError("latest instants and times must ascend")
    kept = np.flatnonzero(np.any(np.isfinite(bounds), axis=0))
    kept = kept[np.unique(instants[1, kept] // _MINUTE, return_index=True)[1]]
    counts = np.searchsorted(instants[1, kept], asked, "right")
    return _enclosures(instants[:, kept], bounds[:, kept], counts, asked, rates, *sizes)


@rounding_to_nearest
def _enclosures(
    instants: Integers,
    bounds: Floats,
    counts: Integers,
    times: Integers,
    rates: tuple[float, float],
    outliers: int,
    memory: int,
) -> Interval:
    out = np.empty((2, times.size))
    find_drifted_hulls(
        np.ascontiguousarray(instants),
        np.ascontiguousarray(bounds),
        counts.astype(np.int64),
        times,
        memory,
        outliers,
        np.array(rates),
        out,
    )
    return as_intervals(out, times.shape).exp()


def _rates_of(drift: Bounds) -> tuple[float, float]:
    """Rates of the logarithm in 1/ns."""
    rate = Interval.of(drift)
    if rate.ndim != 0 or not bool(rate.is_common_interval):
        raise IdentificationError(f"drift must be one bounded interval of rates in 1/s, not {rate}")
    fine = rate / _BILLION
    return float(fine.inf), float(fine.sup)


def _require_sizes(outliers: int, memory: int) -> tuple[int, int]:
    if not 0 <= outliers < memory:
        raise IdentificationError(
            f"outliers and memory must be 0 <= outliers < memory, not {outliers!r} and {memory!r}"
        )
    return outliers, memory


def _times_of(times: ArrayLike, least: int) -> Integers:
    found = np.asarray(times)
    if found.ndim != 1 or (found.size and found.dtype.kind not in "iu"):
        raise IdentificationError(f"times are whole ns along one axis, not {found.dtype}")
    if np.any(found < least) or np.any(found > _LONGEST):
        raise IdentificationError(f"times must lie from {least} to {_LONGEST} ns")
    return found.astype(np.int64)


def _constraints_of(
    earliest: ArrayLike, latest: ArrayLike, constraints: Interval
) -> tuple[Integers, Floats]:
    """Instants, and bounds of the logarithm, both (2, n)."""
    begin, end = (_times_of(each, -_LONGEST) for each in (earliest, latest))
    if begin.shape != end.shape or constraints.shape != end.shape:
        raise IdentificationError(
            f"instants and constraints differ in number: {begin.shape}, {end.shape}, "
            f"{constraints.shape}"
        )
    if np.any(begin > end):
        raise IdentificationError("instants are reversed; give the earliest first")
    if np.any(constraints.is_empty) or np.any(constraints.sup <= 0.0):
        raise IdentificationError("a constraint has no positive member; a parameter is positive")
    positive = Interval(np.maximum(constraints.inf, 0.0), constraints.sup).log()
    return np.stack([begin, end]), np.stack([positive.inf, positive.sup])
