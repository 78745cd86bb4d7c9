"""Three answers to one question: certain, possible, impossible."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from eskin.errors import IntervalError
from eskin.interval.markup import html_table, html_text

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_WORDS: Final = ("certain", "possible", "impossible")


class Verdicts:
    """What is known of a statement about numbers inside of intervals, element by element.

    Combine answers with ``~``, ``&`` and ``|`` (Kleene's logic). A single answer that is decided
    can be asked with ``if``; one that is only possible raises, so that nobody takes it for a yes.

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
            raise IntervalError("an answer is certain and impossible at once")
        self.certain: NDArray[np.bool_] = sure
        self.impossible: NDArray[np.bool_] = never

    @classmethod
    def of(cls, value: Verdicts | ArrayLike) -> Verdicts:
        """The answer itself, or what plain booleans are certain of."""
        if isinstance(value, Verdicts):
            return value
        known = np.asarray(value)
        if known.dtype != np.bool_:
            raise IntervalError(
                f"{value!r} is neither an answer nor a boolean; compare it with something"
            )
        return cls(known, ~known)

    @property
    def possible(self) -> NDArray[np.bool_]:
        """True for some numbers inside, and not for others."""
        return np.asarray(~self.certain & ~self.impossible)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array of answers."""
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

    def all(self, axis: int | tuple[int, ...] | None = None) -> Verdicts:
        """Whether all are true, or all along an axis."""
        return Verdicts(np.all(self.certain, axis=axis), np.any(self.impossible, axis=axis))

    def any(self, axis: int | tuple[int, ...] | None = None) -> Verdicts:
        """Whether one is true, or one along an axis."""
        return Verdicts(np.any(self.certain, axis=axis), np.all(self.impossible, axis=axis))

    def __bool__(self) -> bool:
        if self.certain.size != 1:
            raise IntervalError(
                f"{self.certain.size} answers are no single one; take .all(), .any() or .certain"
            )
        if np.any(self.possible):
            raise IntervalError("only possible: ask for .certain, or for ~answer.impossible")
        return bool(np.all(self.certain))

    def _words(self) -> NDArray[np.str_]:
        return np.where(
            self.certain, "certain", np.where(self.impossible, "impossible", "possible")
        )

    def _repr_html_(self) -> str:
        if self.certain.ndim == 0:
            return html_text(repr(self))
        words = self._words().reshape(-1)
        counts = {word: np.count_nonzero(words == word) for word in _WORDS}
        caption = ", ".join(f"{count} {word}" for word, count in counts.items())

        def row(k: int) -> list[str]:
            return [", ".join(map(str, np.unravel_index(k, self.shape))), str(words[k])]

        return html_table(caption, ["", "answer"], words.size, row)

    def __array__(self, *_: Any, **__: Any) -> NDArray[Any]:
        raise IntervalError("an answer is not one array of booleans: take .certain or .possible")

    def __array_function__(self, function: Any, _: Any, inputs: Any, options: Any) -> Any:
        from eskin.interval.interval import call_numpy  # noqa: PLC0415 - intervals need answers

        return call_numpy(function, inputs, options)

    def __repr__(self) -> str:
        words = self._words()
        return f"Answer({words.tolist()!r})" if self.certain.ndim else f"Answer({words.item()!r})"
