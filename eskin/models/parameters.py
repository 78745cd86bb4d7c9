"""Parameters of a model: named intervals in SI units, and which values each may take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eskin.errors import IntervalError
from eskin.interval import Interval

Floats: TypeAlias = NDArray[np.float64]
Bounds: TypeAlias = Interval | ArrayLike
"""What a model takes for a parameter: an interval, or a number or array for a thin one."""


@dataclass(frozen=True, slots=True)
class Allowed:
    """The values that a parameter may take: from ``least`` to ``greatest``, and ``besides``."""

    least: float
    greatest: float
    besides: float
    text: str

    @property
    def row(self) -> tuple[float, float, float]:
        """The three numbers, as a kernel takes them."""
        return self.least, self.greatest, self.besides


LEAST: Final = 1e-40
"""Least size of a parameter that is not zero: products of seven stay normal floats."""
GREATEST: Final = 1e40
"""Greatest size of a parameter."""
_RANGE: Final = f"from {LEAST:g} to {GREATEST:g}"
POSITIVE: Final = Allowed(LEAST, GREATEST, LEAST, f"> 0, {_RANGE}")
NOT_NEGATIVE: Final = Allowed(LEAST, GREATEST, 0.0, f"0 or {_RANGE}")
FINITE: Final = Allowed(-GREATEST, GREATEST, 0.0, f"from {-GREATEST:g} to {GREATEST:g}")


@dataclass(frozen=True, slots=True)
class Parameter:
    """One named parameter.

    Attributes:
        name: As the caller of the model wrote it.
        inf: Lower bounds, float64.
        sup: Upper bounds, the same shape.
        allowed: The values that it may take; a kernel checks them while it reads.
    """

    name: str
    inf: Floats
    sup: Floats
    allowed: Allowed

    def require_allowed(self) -> None:
        """Check all values.

        Raises:
            IntervalError: One is not allowed, empty, or NaN; it names the parameter and the value.
        """
        least, greatest, besides = self.allowed.least, self.allowed.greatest, self.allowed.besides
        good = np.ones(self.inf.shape, dtype=np.bool_)
        for bound in (self.inf, self.sup):
            good &= ((bound >= least) & (bound <= greatest)) | (bound == besides)
        if not np.all(good):
            where = tuple(int(axis) for axis in np.argwhere(~np.asarray(good))[0])
            raise IntervalError(
                f"{self.name} must be {self.allowed.text}, "
                f"is {describe(self.inf[where], self.sup[where])}{at(where)}"
            )

    @property
    def interval(self) -> Interval:
        """Its values."""
        return Interval._trusted(self.inf, self.sup)  # noqa: SLF001 - bounds were checked


def at(where: tuple[int, ...]) -> str:
    """`` at index …`` for a message, nothing for a single value."""
    return f" at index {where}" if where else ""


def describe(inf: float, sup: float) -> str:
    """A value for a message: a number where it is thin."""
    if inf > sup:
        return "empty"
    return f"{float(inf)!r}" if inf == sup else f"[{float(inf)!r}, {float(sup)!r}]"


def parameter(name: str, value: Bounds, allowed: Allowed) -> Parameter:
    """Name a parameter; its values are checked when a kernel reads them.

    Raises:
        IntervalError: It is no array of real numbers, or carries a unit.
    """
    # Not of its subclasses: arrays with units, masked ones.
    if type(value) is np.ndarray and value.dtype == np.float64:
        return Parameter(name, value, value, allowed)
    try:
        bounds = value if isinstance(value, Interval) else Interval(value)
    except IntervalError as error:
        raise IntervalError(f"{name}: {error}") from error
    return Parameter(name, np.asarray(bounds.inf), np.asarray(bounds.sup), allowed)


def positive(name: str, value: Bounds) -> Parameter:
    """A parameter greater than zero, within `LEAST` and `GREATEST`."""
    return parameter(name, value, POSITIVE)


def not_negative(name: str, value: Bounds) -> Parameter:
    """A parameter of zero or more, at most `GREATEST`."""
    return parameter(name, value, NOT_NEGATIVE)


def finite(name: str, value: Bounds) -> Parameter:
    """A parameter of either sign, at most `GREATEST`."""
    return parameter(name, value, FINITE)


def thin(name: str, value: Bounds, allowed: Allowed) -> Parameter:
    """A parameter that the model needs as plain numbers.

    Raises:
        IntervalError: It is an interval with two different ends.
    """
    made = parameter(name, value, allowed)
    good = made.inf == made.sup
    if made.inf is not made.sup and not np.all(good):
        where = tuple(int(axis) for axis in np.argwhere(~np.asarray(good))[0])
        raise IntervalError(
            f"{name} must be one number each, is {describe(made.inf[where], made.sup[where])}"
            f"{at(where)}; take the hull over parts of it where it is uncertain"
        )
    return made


def require_order(smaller: Parameter, greater: Parameter, *, strict: bool) -> None:
    """Check that one parameter lies below another for all of their members.

    Raises:
        IntervalError: It does not; shapes that do not fit each other are left to the model.
    """
    try:
        pairs = np.broadcast_arrays(smaller.inf, smaller.sup, greater.inf, greater.sup)
    except ValueError:
        return
    good = (pairs[1] < pairs[2]) if strict else (pairs[1] <= pairs[2])
    if not np.all(good):
        smaller.require_allowed()
        greater.require_allowed()
        where = tuple(int(axis) for axis in np.argwhere(~np.asarray(good))[0])
        small, great = (describe(pairs[k][where], pairs[k + 1][where]) for k in (0, 2))
        raise IntervalError(
            f"{smaller.name} must be {'less than' if strict else 'at most'} {greater.name}, "
            f"is {small} beside {great}{at(where)}"
        )
