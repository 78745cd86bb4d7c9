"""Three-valued predicates on samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eskin.interval import Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eskin.interval import Floats


@dataclass(frozen=True, slots=True)
class Predicate:
    """Whether a value lies in a band, or outside of it; at least one end is given.

    The verdict of a sample is certain if its whole interval is in that state, impossible if none of
    it is, else possible; an unknown sample is possible.

    Attributes:
        low: The band's lower end, in the channel's unit; ``None`` for a band without one.
        high: Its upper end.
        strict: Whether its ends are no part of it.
        outside: Whether outside is asked.
    """

    low: float | None
    high: float | None
    strict: bool = False
    outside: bool = False

    def certain(self, lo: Any, hi: Any) -> Any:
        """Whether intervals are all in the state: of arrays, or of a table's columns."""
        return ~self._touch(lo, hi) if self.outside else self._within(lo, hi)

    def possible(self, lo: Any, hi: Any) -> Any:
        """Whether intervals are in the state somewhere: of arrays, or of a table's columns."""
        return ~self._within(lo, hi) if self.outside else self._touch(lo, hi)

    def answers(self, lo: Floats, hi: Floats) -> NDArray[np.int8]:
        """The answer for each interval."""
        found: NDArray[np.int8] = self.certain(lo, hi).astype(np.int8) + self.possible(lo, hi)
        return found

    def answer(self, lo: float, hi: float) -> Verdict | None:
        """The answer for all samples within these bounds; ``None`` if they may differ."""
        bounds = np.float64(lo), np.float64(hi)
        if self.certain(*bounds):
            return Verdict.CERTAIN
        return None if self.possible(*bounds) else Verdict.IMPOSSIBLE

    def _within(self, lo: Any, hi: Any) -> Any:
        return self._both(lo, hi)

    def _touch(self, lo: Any, hi: Any) -> Any:
        return self._both(hi, lo)

    def _both(self, above: Any, below: Any) -> Any:
        """Whether one number is above the lower end, and one below the upper end."""
        if self.low is None:
            return below < self.high if self.strict else below <= self.high
        found = above > self.low if self.strict else above >= self.low
        if self.high is None:
            return found
        return found & (below < self.high if self.strict else below <= self.high)
