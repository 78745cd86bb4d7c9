"""Numbers become bounds: exactly where a float can hold them, outward where none can."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from eskin.errors import EskinError, IntervalError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = "NDArray[np.float64]"
"""Sides of intervals: an array of binary64, of any shape."""

_EXACT_INTEGER = 2**53
_PLAIN = frozenset({bool, int, float, np.ndarray, np.float64})
"""Types that carry no unit, looked up before any other question."""


def unit_of(value: object) -> str | None:
    """The unit that a value carries: of pint, unyt and quantities ``units``, of astropy ``unit``.

    Of lists and tuples the first that one of their items carries; ``None`` of plain numbers.
    """
    kind = type(value)
    if kind in _PLAIN:
        return None
    if isinstance(value, list | tuple):
        if _PLAIN.issuperset(map(type, value)):  # 10 ns an item
            return None
        units = (unit_of(item) for item in value if type(item) not in _PLAIN)
        return next((unit for unit in units if unit is not None), None)
    for attribute in ("units", "unit"):
        unit = getattr(value, attribute, None)
        if unit is not None:
            return str(unit) or "1"
    return None


def require_plain(value: object, name: str, error: type[EskinError] = IntervalError) -> None:
    """Reject a value that carries a unit, which numpy would drop without a word.

    Args:
        value: What a caller gave for numbers.
        name: What the caller calls it, for the error.
        error: What to raise.

    Raises:
        error: It carries a unit, even that of a pure number: 5 % is not 5.
    """
    unit = unit_of(value)
    if unit is not None:
        raise error(
            f"{name} carries the unit {unit!r}; eskin takes plain numbers in SI units: give "
            "value.to('m').magnitude (pint) or value.to_value('m') (astropy, unyt), with the SI "
            "unit of this parameter for 'm'; of a tube, take its values"
        )


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


def enclose(value: ArrayLike, name: str) -> tuple[Floats, Floats]:
    """The greatest floats not above real numbers, and the least not below.

    Args:
        value: Booleans, integers of any size, or real floats of any precision.
        name: What the caller calls it, for the error.

    Raises:
        IntervalError: It holds anything else, or rows of different lengths, or carries a unit.
    """
    require_plain(value, name)
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        where = first_index(np.ma.getmaskarray(value))
        raise IntervalError(
            f"{name} is masked at index {where}; fill it (entire: -inf, inf) or leave it out first"
        )
    try:
        array = np.asarray(value)
    except (ValueError, TypeError, OverflowError) as error:
        raise IntervalError(f"{name} is no array of numbers: {error}") from error
    if array.dtype.kind == "b" or array.dtype in (np.float64, np.float32, np.float16):
        exact = array.astype(np.float64, copy=False)
        return exact, exact
    if array.dtype.kind in "iuO":
        return _enclose_integers(array, name)
    if array.dtype.kind == "f":
        with np.errstate(over="ignore"):
            near = array.astype(np.float64)
        wide = near.astype(array.dtype)
        return np.where(wide > array, round_down(near), near), np.where(
            wide < array, round_up(near), near
        )
    raise IntervalError(
        f"{name} has dtype {array.dtype}; intervals need real numbers (booleans, integers, floats)"
    )


def _enclose_integers(array: NDArray[Any], name: str) -> tuple[Floats, Floats]:
    if array.dtype.kind == "O":
        for index, item in np.ndenumerate(array):
            if not isinstance(item, int):
                raise IntervalError(
                    f"{name} holds {item!r} ({type(item).__name__}) at index {index}; intervals "
                    "need real numbers; join intervals with Interval.stack"
                )
    elif array.size == 0 or (
        int(array.min()) >= -_EXACT_INTEGER and int(array.max()) <= _EXACT_INTEGER
    ):
        exact = array.astype(np.float64)
        return exact, exact
    pairs = [_enclose_integer(int(item)) for item in array.ravel().tolist()]
    lo, hi = (
        np.array(pairs, dtype=np.float64).reshape(*array.shape, 2).transpose(-1, *range(array.ndim))
    )
    return lo, hi


def _enclose_integer(number: int) -> tuple[float, float]:
    try:
        near = float(number)
    except OverflowError:
        edge = float(np.finfo(np.float64).max)
        return (edge, np.inf) if number > 0 else (-np.inf, -edge)
    below = near if int(near) <= number else float(np.nextafter(near, -np.inf))
    above = near if int(near) >= number else float(np.nextafter(near, np.inf))
    return below, above


def as_compiled(array: Floats) -> Floats:
    """The array as kernels are compiled for: contiguous, aligned and writable; a copy if it is not.

    A kernel would be compiled anew, in seconds, for arrays that are read-only or strided.
    """
    flags = array.flags  # numpy warns where one asks a broadcast array whether it is writable
    return array if flags.c_contiguous and flags.carray else array.copy()


def first_index(where: NDArray[np.bool_]) -> tuple[int, ...]:
    """The first index at which something is true."""
    return tuple(int(axis) for axis in np.argwhere(where)[0])


def require_order(inf: Floats, sup: Floats) -> None:
    """Check that bounds are those of intervals that are not empty.

    Raises:
        IntervalError: Somewhere they are not.
    """
    good = (inf <= sup) & (inf < np.inf) & (sup > -np.inf)
    if np.all(good):
        return
    where = first_index(~good)
    lo, hi = float(inf[where]), float(sup[where])
    if np.isnan(lo) or np.isnan(hi):
        fault = "a bound is NaN"
    elif lo > hi:
        fault = "lo > hi"
    else:
        fault = "infinity is a bound, not a number"
    raise IntervalError(
        f"{fault} at index {where}: lo={lo!r}, hi={hi!r}; "
        "an interval without members is Interval.empty()"
    )
