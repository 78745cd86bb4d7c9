"""Verdicts of three values: impossible, possible, certain."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.markup import html_table, html_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray


class Verdict(IntEnum):
    """Whether a statement about a value holds, where an interval encloses the value."""

    IMPOSSIBLE = 0
    """It holds for no number inside."""
    POSSIBLE = 1
    """It holds for some numbers inside, or it is not known to fail."""
    CERTAIN = 2
    """It holds for every number inside."""


class Verdicts:
    """An array of verdicts, as comparisons of intervals give it.

    Combine verdicts with ``~``, ``&`` and ``|`` (Kleene's logic). A single verdict that is certain
    or impossible works in ``if``; a possible one raises, so that it cannot pass for true.

    Attributes:
        certain: True for all numbers inside.
        impossible: True for none.
    """

    __slots__ = ("certain", "impossible")
    __array_ufunc__ = None
    __hash__ = None  # type: ignore[assignment]  # arrays: no key of a dict

    def __init__(self, certain: ArrayLike, impossible: ArrayLike) -> None:
        sure, never = np.broadcast_arrays(np.asarray(certain, bool), np.asarray(impossible, bool))
        if np.any(sure & never):
            raise IntervalError("a verdict is certain and impossible at once")
        self.certain: NDArray[np.bool_] = sure
        self.impossible: NDArray[np.bool_] = never

    @classmethod
    def of(cls, value: Verdicts | ArrayLike) -> Verdicts:
        """The verdicts themselves, or those of plain booleans."""
        if isinstance(value, Verdicts):
            return value
        known = np.asarray(value)
        if known.dtype != np.bool_:
            raise IntervalError(
                f"{value!r} is neither a verdict nor a boolean; compare it with something"
            )
        return cls(known, ~known)

    @property
    def possible(self) -> NDArray[np.bool_]:
        """True for some numbers inside, and not for others."""
        return np.asarray(~self.certain & ~self.impossible)

    @property
    def codes(self) -> NDArray[np.int8]:
        """Values of `Verdict`."""
        return np.add(self.certain, ~self.impossible, dtype=np.int8)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array of verdicts."""
        return self.certain.shape

    def __getitem__(self, index: Any) -> Verdicts:
        return Verdicts(self.certain[index], self.impossible[index])

    def __invert__(self) -> Verdicts:
        return Verdicts(self.impossible, self.certain)

    def __and__(self, other: Verdicts | ArrayLike) -> Verdicts:
        that = self.of(other)
        return Verdicts(self.certain & that.certain, self.impossible | that.impossible)

    def __or__(self, other: Verdicts | ArrayLike) -> Verdicts:
        that = self.of(other)
        return Verdicts(self.certain | that.certain, self.impossible & that.impossible)

    def __xor__(self, other: Verdicts | ArrayLike) -> Verdicts:
        that = self.of(other)
        return (self & ~that) | (~self & that)

    __rand__, __ror__, __rxor__ = __and__, __or__, __xor__

    def item(self) -> Verdict:
        """The only verdict.

        Raises:
            IntervalError: There is not exactly one.
        """
        if self.certain.size != 1:
            raise IntervalError(
                f"one verdict is needed, not {self.certain.size}; take .all(), .any() or .codes"
            )
        return Verdict(self.codes.item())

    def all(self, axis: int | tuple[int, ...] | None = None) -> Verdicts:
        """Whether all are true, or all along an axis."""
        return Verdicts(np.all(self.certain, axis=axis), np.any(self.impossible, axis=axis))

    def any(self, axis: int | tuple[int, ...] | None = None) -> Verdicts:
        """Whether one is true, or one along an axis."""
        return Verdicts(np.any(self.certain, axis=axis), np.all(self.impossible, axis=axis))

    def __bool__(self) -> bool:
        verdict = self.item()
        if verdict is Verdict.POSSIBLE:
            raise IntervalError("only possible: ask for .certain, or for ~verdicts.impossible")
        return verdict is Verdict.CERTAIN

    def _words(self) -> NDArray[np.str_]:
        return np.array([each.name.lower() for each in Verdict])[self.codes]

    def _repr_html_(self) -> str:
        if self.certain.ndim == 0:
            return html_text(repr(self))
        words = self._words().reshape(-1)
        counts = {
            word: np.count_nonzero(words == word) for word in ("certain", "possible", "impossible")
        }
        caption = ", ".join(f"{count} {word}" for word, count in counts.items())

        def row(k: int) -> list[str]:
            return [", ".join(map(str, np.unravel_index(k, self.shape))), str(words[k])]

        return html_table(caption, ["", "verdict"], words.size, row)

    def __array__(self, *_: Any, **__: Any) -> NDArray[Any]:
        raise IntervalError("verdicts are not one array of booleans: take .certain or .possible")

    def __array_function__(self, function: Any, _: Any, inputs: Any, options: Any) -> Any:
        return call_numpy(function, inputs, options)

    def __repr__(self) -> str:
        words = self._words()
        return (
            f"Verdicts({words.tolist()!r})" if self.certain.ndim else f"Verdicts({words.item()!r})"
        )


NUMPY_FUNCTIONS: Final[dict[Any, Callable[..., Any]]] = {
    np.all: lambda verdicts, axis=None: Verdicts.of(verdicts).all(axis),
    np.any: lambda verdicts, axis=None: Verdicts.of(verdicts).any(axis),
    np.shape: lambda x: x.shape,
}
"""What numpy's functions do with verdicts and intervals; `eskin.interval.interval` adds its own."""


def call_numpy(function: Any, inputs: Any, options: Any) -> Any:
    """Call numpy's function with intervals or verdicts.

    Raises:
        IntervalError: It is not defined for them.
    """
    if function not in NUMPY_FUNCTIONS:
        raise IntervalError(
            f"numpy's {function.__name__} is not defined for intervals and verdicts; take .inf, "
            ".sup or .mid, .certain or .impossible"
        )
    return NUMPY_FUNCTIONS[function](*inputs, **options)
