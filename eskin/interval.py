"""Intervals: arrays of closed bounds ``[lo, hi]`` that enclose the truth.

Names are those of IEEE 1788-2015 (inf, sup, wid, mid, hull, intersection, subset, disjoint). Every
operation rounds outward: the exact result of any members of the operands lies in the result.

Rounding: numpy's ``+ - * / sqrt`` are correctly rounded, so one ulp outward encloses. ``exp`` and
``log`` come from a vectorised libm that nobody certifies; 4 ulp outward is allowed for them.
An unbounded side is an infinity; ``[-inf, inf]`` says that nothing is known.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np

from eskin.errors import IntervalError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = "NDArray[np.float64]"

_LIBM_ULP = 4


def round_down(value: Floats, ulp: int = 1) -> Floats:
    """Move each value ``ulp`` floats towards minus infinity."""
    with np.errstate(over="ignore", under="ignore"):
        for _ in range(ulp):
            value = np.nextafter(value, -np.inf)
    return value


def round_up(value: Floats, ulp: int = 1) -> Floats:
    """Move each value ``ulp`` floats towards plus infinity."""
    with np.errstate(over="ignore", under="ignore"):
        for _ in range(ulp):
            value = np.nextafter(value, np.inf)
    return value


class Interval:
    """An array of closed intervals.

    Attributes:
        inf: Lower bounds, float64, any shape.
        sup: Upper bounds, the same shape.

    Raises:
        IntervalError: A bound is NaN or no real number, ``lo > hi``, or the shapes do not fit.
    """

    __slots__ = ("inf", "sup")
    __array_ufunc__ = None  # numpy's operators leave the work to ours
    __hash__ = None  # type: ignore[assignment]  # intervals are arrays: equal to nothing as a key

    def __init__(self, lo: ArrayLike, hi: ArrayLike | None = None) -> None:
        inf = _real(lo, "lo")
        sup = inf if hi is None else _real(hi, "hi")
        if inf.shape != sup.shape:
            try:
                inf, sup = np.broadcast_arrays(inf, sup)
            except ValueError as error:
                raise IntervalError(f"lo and hi do not fit each other: {error}") from error
        _require_order(inf, sup)
        self.inf: Floats = inf
        self.sup: Floats = sup

    @classmethod
    def _trusted(cls, inf: Floats, sup: Floats) -> Self:
        made = cls.__new__(cls)
        made.inf = np.asarray(inf)
        made.sup = np.asarray(sup)
        return made

    @classmethod
    def around(cls, value: ArrayLike, radius: ArrayLike) -> Self:
        """``[value - radius, value + radius]``, rounded outward."""
        mid, rad = _real(value, "value"), _real(radius, "radius")
        return cls(round_down(mid - rad), round_up(mid + rad))

    @classmethod
    def relative(cls, value: ArrayLike, tolerance: ArrayLike) -> Self:
        """``value · [1 - tolerance, 1 + tolerance]``, rounded outward: a part's data sheet."""
        return cls(value) * cls.around(1.0, tolerance)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array of intervals."""
        return self.inf.shape

    def __len__(self) -> int:
        return len(self.inf)

    def __getitem__(self, index: Any) -> Self:
        return self._trusted(self.inf[index], self.sup[index])

    def __repr__(self) -> str:
        if self.inf.ndim == 0:
            return f"Interval([{float(self.inf)!r}, {float(self.sup)!r}])"
        return f"Interval(lo={self.inf!r}, hi={self.sup!r})"

    def __neg__(self) -> Self:
        return self._trusted(-self.sup, -self.inf)

    def __add__(self, other: Interval | ArrayLike) -> Self:
        that = as_interval(other)
        with np.errstate(over="ignore", invalid="ignore"):
            lo, hi = self.inf + that.inf, self.sup + that.sup
        # inf - inf: that side is unbounded.
        lo, hi = np.where(np.isnan(lo), -np.inf, lo), np.where(np.isnan(hi), np.inf, hi)
        return self._trusted(round_down(lo), round_up(hi))

    __radd__ = __add__

    def __sub__(self, other: Interval | ArrayLike) -> Self:
        return self + (-as_interval(other))

    def __rsub__(self, other: ArrayLike) -> Self:
        return -self + other

    def __mul__(self, other: Interval | ArrayLike) -> Self:
        that = as_interval(other)
        with np.errstate(invalid="ignore", over="ignore", under="ignore"):
            corners = [
                # 0 · inf is 0 here: an unbounded side times exactly zero is zero.
                np.nan_to_num(a * b, nan=0.0, posinf=np.inf, neginf=-np.inf)
                for a in (self.inf, self.sup)
                for b in (that.inf, that.sup)
            ]
        return self._trusted(
            round_down(np.minimum.reduce(corners)), round_up(np.maximum.reduce(corners))
        )

    __rmul__ = __mul__

    def reciprocal(self) -> Self:
        """``1/x``; ``[-inf, inf]`` where zero lies inside, half of it where zero is an end."""
        with np.errstate(divide="ignore", over="ignore"):
            lo = round_down(1.0 / np.where(self.sup == 0.0, -0.0, self.sup))
            hi = round_up(1.0 / np.where(self.inf == 0.0, 0.0, self.inf))
        inside = (self.inf < 0.0) & (self.sup > 0.0)
        zero = (self.inf == 0.0) & (self.sup == 0.0)
        lo = np.where(inside | zero, -np.inf, lo)
        hi = np.where(inside | zero, np.inf, hi)
        return self._trusted(lo, hi)

    def __truediv__(self, other: Interval | ArrayLike) -> Self:
        return self * as_interval(other).reciprocal()

    def __rtruediv__(self, other: ArrayLike) -> Interval:
        return as_interval(other) * self.reciprocal()

    def square(self) -> Self:
        """``x²``, never negative (tighter than ``x * x``)."""
        mag, mig = self.mag, self.mig
        with np.errstate(over="ignore", under="ignore"):
            lo, hi = round_down(mig * mig), round_up(mag * mag)
        return self._trusted(np.maximum(lo, 0.0), hi)

    def sqrt(self) -> Self:
        """Square root.

        Raises:
            IntervalError: A lower bound is negative.
        """
        self._require(self.inf >= 0.0, "sqrt needs lo >= 0; intersect with [0, inf] first")
        lo = np.maximum(round_down(np.sqrt(self.inf)), 0.0)
        return self._trusted(lo, round_up(np.sqrt(self.sup)))

    def exp(self) -> Self:
        """Exponential, never negative."""
        with np.errstate(over="ignore", under="ignore"):
            lo, hi = np.exp(self.inf), np.exp(self.sup)
        return self._trusted(np.maximum(round_down(lo, _LIBM_ULP), 0.0), round_up(hi, _LIBM_ULP))

    def log(self) -> Self:
        """Natural logarithm; ``-inf`` where the lower bound is zero.

        Raises:
            IntervalError: A lower bound is negative, or an interval is ``[0, 0]``.
        """
        self._require(
            (self.inf >= 0.0) & (self.sup > 0.0),
            "log needs lo >= 0 and hi > 0; intersect with [0, inf] first",
        )
        with np.errstate(divide="ignore"):
            lo, hi = np.log(self.inf), np.log(self.sup)
        return self._trusted(round_down(lo, _LIBM_ULP), round_up(hi, _LIBM_ULP))

    @property
    def wid(self) -> Floats:
        """Width ``hi - lo``, rounded up."""
        with np.errstate(over="ignore", invalid="ignore"):
            width = round_up(self.sup - self.inf)
        return np.where(self.sup == self.inf, 0.0, width)

    @property
    def mid(self) -> Floats:
        """A point inside: the middle, or the finite end of a half-unbounded interval."""
        with np.errstate(invalid="ignore"):
            middle = 0.5 * self.inf + 0.5 * self.sup
        lo_open, hi_open = np.isinf(self.inf), np.isinf(self.sup)
        ends = np.where(lo_open & hi_open, 0.0, np.where(lo_open, self.sup, self.inf))
        return np.where(lo_open | hi_open, ends, np.clip(middle, self.inf, self.sup))

    @property
    def mag(self) -> Floats:
        """Greatest absolute value inside."""
        return np.maximum(np.abs(self.inf), np.abs(self.sup))

    @property
    def mig(self) -> Floats:
        """Smallest absolute value inside."""
        least = np.minimum(np.abs(self.inf), np.abs(self.sup))
        return np.where((self.inf <= 0.0) & (self.sup >= 0.0), 0.0, least)

    def contains(self, value: ArrayLike) -> NDArray[np.bool_]:
        """Whether each value lies inside."""
        point = _real(value, "value")
        return (self.inf <= point) & (point <= self.sup)

    def subset(self, other: Interval | ArrayLike) -> NDArray[np.bool_]:
        """Whether each interval lies inside the other."""
        that = as_interval(other)
        return (that.inf <= self.inf) & (self.sup <= that.sup)

    def disjoint(self, other: Interval | ArrayLike) -> NDArray[np.bool_]:
        """Whether they have no point in common."""
        that = as_interval(other)
        return (self.sup < that.inf) | (that.sup < self.inf)

    def intersection(self, other: Interval | ArrayLike) -> Self:
        """The common part.

        Raises:
            IntervalError: Somewhere there is none.
        """
        that = as_interval(other)
        self._require(~self.disjoint(that), f"no common point with {that!r}")
        return self._trusted(np.maximum(self.inf, that.inf), np.minimum(self.sup, that.sup))

    def hull(self, other: Interval | ArrayLike) -> Self:
        """The smallest interval that holds both."""
        that = as_interval(other)
        return self._trusted(np.minimum(self.inf, that.inf), np.maximum(self.sup, that.sup))

    def _require(self, holds: NDArray[np.bool_], what: str) -> None:
        if not np.all(holds):
            where = tuple(int(axis) for axis in np.argwhere(~np.asarray(holds))[0])
            raise IntervalError(
                f"{what}; at index {where}: "
                f"[{self.inf[where] if where else self.inf}, "
                f"{self.sup[where] if where else self.sup}]"
            )


def as_interval(value: Interval | ArrayLike) -> Interval:
    """The interval itself, or the thin interval of a plain number or array."""
    return value if isinstance(value, Interval) else Interval(value)


def _real(value: ArrayLike, name: str) -> Floats:
    array = np.asarray(value)
    if array.dtype.kind not in "iufb":
        raise IntervalError(f"{name} has dtype {array.dtype}; intervals need real numbers")
    return array.astype(np.float64, copy=False)


def _require_order(inf: Floats, sup: Floats) -> None:
    good = inf <= sup
    if not np.all(good):
        where = tuple(int(axis) for axis in np.argwhere(~good)[0])
        lo, hi = float(inf[where]), float(sup[where])
        fault = "a bound is NaN" if lo != lo or hi != hi else "lo > hi"  # noqa: PLR0124 - NaN test
        raise IntervalError(f"{fault} at index {where}: lo={lo!r}, hi={hi!r}")
