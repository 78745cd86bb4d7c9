"""Intervals as sets, and the numbers that describe them; IEEE 1788-2015, 10.5.7 to 10.5.10."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.conversion import enclose, round_up
from eskin.interval.decoration import undefined_where
from eskin.interval.functions import Functions
from eskin.interval.verdict import Verdicts

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from eskin.interval.bounds import Bounds
    from eskin.interval.conversion import Floats

_GREATEST = float(np.finfo(np.float64).max)


class Sets(Functions):
    """Members, relations and sizes."""

    __slots__ = ()

    @property
    def is_empty(self) -> NDArray[np.bool_]:
        """Whether each has no member."""
        return np.asarray(self.inf > self.sup)

    @property
    def is_entire(self) -> NDArray[np.bool_]:
        """Whether each holds all real numbers."""
        return np.asarray((self.inf == -np.inf) & (self.sup == np.inf))

    @property
    def is_singleton(self) -> NDArray[np.bool_]:
        """Whether each has one member."""
        return np.asarray(self.inf == self.sup)

    @property
    def is_common_interval(self) -> NDArray[np.bool_]:
        """Whether each is bounded and not empty."""
        return np.asarray(np.isfinite(self.inf) & np.isfinite(self.sup))

    @property
    def wid(self) -> Floats:
        """Width, rounded up; NaN for the empty interval."""
        with np.errstate(over="ignore", invalid="ignore"):
            width = self.sup - self.inf
            error = self._difference_error(width)
        rounded = np.where(error > 0.0, round_up(width), width)
        return np.where(self.is_empty, np.nan, rounded)

    def _difference_error(self, width: Floats) -> Floats:
        """What ``sup - inf`` lost to rounding; NaN where that is unbounded."""
        part = width - self.sup
        error = (self.sup - (width - part)) - (self.inf + part)
        return np.where(np.isnan(error), 0.0, error)

    @property
    def mid(self) -> Floats:
        """A member near the middle; ±the greatest float if one side is unbounded, 0 if both are."""
        with np.errstate(over="ignore", invalid="ignore"):
            total = self.inf + self.sup
            halves = np.where(np.isfinite(total), 0.5 * total, 0.5 * self.inf + 0.5 * self.sup)
            middle = np.clip(halves + 0.0, self.inf, self.sup)
        middle = np.where(self.inf == -np.inf, -_GREATEST, middle)
        middle = np.where(self.sup == np.inf, _GREATEST, middle)
        middle = np.where(self.is_entire, 0.0, middle)
        return np.where(self.is_empty, np.nan, middle)

    @property
    def rad(self) -> Floats:
        """Radius: the least float with every member within it of `mid`; NaN for the empty one."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.maximum(
                self._trusted(self.inf, self.mid).wid, self._trusted(self.mid, self.sup).wid
            )

    @property
    def mag(self) -> Floats:
        """Greatest magnitude inside; NaN for the empty interval."""
        return np.where(self.is_empty, np.nan, np.maximum(np.abs(self.inf), np.abs(self.sup)))

    @property
    def mig(self) -> Floats:
        """Least magnitude inside; NaN for the empty interval."""
        least = np.maximum(np.maximum(self.inf, -self.sup), 0.0)
        return np.where(self.is_empty, np.nan, least)

    def contains(self, value: ArrayLike) -> NDArray[np.bool_]:
        """Whether each number is a member; infinity and NaN are none of any."""
        below, above = enclose(value, "value")
        return np.asarray((self.inf <= below) & (above <= self.sup) & np.isfinite(below))

    is_member = contains

    def convex_hull(self, other: Bounds | ArrayLike) -> Self:
        """The least interval that holds both."""
        that = self.of(other)
        return self._trusted(np.minimum(self.inf, that.inf), np.maximum(self.sup, that.sup))

    hull = convex_hull

    @classmethod
    def where(
        cls, condition: Verdicts | ArrayLike, x: Bounds | ArrayLike, y: Bounds | ArrayLike
    ) -> Self:
        """``x`` where the condition is certain, ``y`` where it is impossible, else their hull.

        Args:
            condition: What a comparison answers, or plain booleans.
            x: What is taken where it is true.
            y: What is taken where it is false.
        """
        asked, true, false = Verdicts.of(condition), cls.of(x), cls.of(y)
        try:
            either = true.convex_hull(false)
            lo, hi = (
                np.select([asked.certain, asked.impossible], [one, other], both)
                for one, other, both in (
                    (true.inf, false.inf, either.inf),
                    (true.sup, false.sup, either.sup),
                )
            )
        except ValueError as error:
            raise IntervalError(f"condition, x and y do not fit each other: {error}") from error
        return cls._trusted(lo, hi)

    def clip(
        self, lo: Bounds | ArrayLike | None = None, hi: Bounds | ArrayLike | None = None
    ) -> Self:
        """The greater of this and ``lo``, and the lesser of that and ``hi``."""
        raised = self if lo is None else self.greater(lo)
        return raised if hi is None else raised.lesser(hi)

    def intersection(self, other: Bounds | ArrayLike) -> Self:
        """The common members; empty where there are none.

        As IEEE 1788-2015, 11.7.1 has it, no function is known to be defined where this cuts.
        """
        that = self.of(other)
        undefined_where(lambda: ~self.equal(that))
        lo, hi = np.maximum(self.inf, that.inf), np.minimum(self.sup, that.sup)
        return self._trusted(np.where(lo <= hi, lo, np.inf), np.where(lo <= hi, hi, -np.inf))

    def equal(self, other: Bounds | ArrayLike) -> NDArray[np.bool_]:
        """Whether both are the same set."""
        that = self.of(other)
        return np.asarray((self.inf == that.inf) & (self.sup == that.sup))

    def subset(self, other: Bounds | ArrayLike) -> NDArray[np.bool_]:
        """Whether every member is one of the other's."""
        that = self.of(other)
        return np.asarray((that.inf <= self.inf) & (self.sup <= that.sup))

    def interior(self, other: Bounds | ArrayLike) -> NDArray[np.bool_]:
        """Whether it lies in the other's interior."""
        that = self.of(other)
        left = (that.inf < self.inf) | ((that.inf == -np.inf) & (self.inf == -np.inf))
        right = (self.sup < that.sup) | ((that.sup == np.inf) & (self.sup == np.inf))
        return np.asarray((left & right) | self.is_empty)

    def disjoint(self, other: Bounds | ArrayLike) -> NDArray[np.bool_]:
        """Whether they have no member in common."""
        that = self.of(other)
        apart = (self.sup < that.inf) | (that.sup < self.inf)
        return np.asarray(apart | self.is_empty | that.is_empty)

    def less(self, other: Bounds | ArrayLike) -> NDArray[np.bool_]:
        """Weakly less: each member has one of the other's that is not less, and the reverse."""
        that = self.of(other)
        return np.asarray((self.inf <= that.inf) & (self.sup <= that.sup))

    def strict_less(self, other: Bounds | ArrayLike) -> NDArray[np.bool_]:
        """Strictly less: each member has one of the other's that is greater, and the reverse."""
        that = self.of(other)
        left = (self.inf < that.inf) | ((self.inf == -np.inf) & (that.inf == -np.inf))
        right = (self.sup < that.sup) | ((self.sup == np.inf) & (that.sup == np.inf))
        return np.asarray((left & right) | (self.is_empty & that.is_empty))

    def precedes(self, other: Bounds | ArrayLike) -> NDArray[np.bool_]:
        """Whether it lies left of the other, or touches it."""
        that = self.of(other)
        return np.asarray(self.sup <= that.inf)

    def strict_precedes(self, other: Bounds | ArrayLike) -> NDArray[np.bool_]:
        """Whether it lies left of the other, and does not touch it."""
        that = self.of(other)
        return np.asarray((self.sup < that.inf) | self.is_empty | that.is_empty)

    def overlap(self, other: Bounds | ArrayLike) -> NDArray[np.str_]:
        """How they lie, in one of the 16 words of IEEE 1788-2015, 10.6.4, such as ``starts``."""
        that = self.of(other)
        a, b, c, d = self.inf, self.sup, that.inf, that.sup
        states = {
            "both_empty": self.is_empty & that.is_empty,
            "first_empty": self.is_empty,
            "second_empty": that.is_empty,
            "before": b < c,
            "after": d < a,
            "equals": (a == c) & (b == d),
            "meets": (b == c) & (a < b) & (c < d),
            "met_by": (d == a) & (a < b) & (c < d),
            "starts": (a == c) & (b < d),
            "started_by": (a == c) & (d < b),
            "finishes": (b == d) & (c < a),
            "finished_by": (b == d) & (a < c),
            "contained_by": (c < a) & (b < d),
            "contains": (a < c) & (d < b),
            "overlaps": a < c,
        }
        return np.select(list(states.values()), list(states), "overlapped_by")
