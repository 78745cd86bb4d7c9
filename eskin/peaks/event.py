"""A peak as an event, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

from eskin.errors import IntervalError
from eskin.interval import require_plain

if TYPE_CHECKING:
    from eskin.interval import Verdict


@dataclass(frozen=True, slots=True)
class PeakEvent:
    """One certain peak, or one region with a number of possible peaks.

    Attributes:
        verdict: Certain or possible.
        first: Index of the sample a before the peak.
        last: Index of the sample c after the peak.
        count: ``(fewest, most)`` peaks: ``(1, 1)`` if certain, ``(0, n)`` if possible.
        height: Enclosure of the greatest value between first and last, in the signal's unit.
        prominence: Enclosure of the height above the higher of the two lowest points beside it,
            within first to last.
    """

    verdict: Verdict
    first: int
    last: int
    count: tuple[int, int]
    height: tuple[float, float]
    prominence: tuple[float, float]


def require_prominence(prominence: float) -> None:
    """Check a least prominence.

    Raises:
        ValueError: It is not positive and finite.
        IntervalError: It carries a unit.
    """
    require_plain(prominence, "prominence")
    if not 0.0 < prominence < inf:
        raise ValueError(f"prominence must be positive and finite, not {prominence}")


def no_interval(index: int, lo: float, hi: float) -> IntervalError:
    """The error for a sample whose bounds are no interval."""
    return IntervalError(
        f"sample {index} is no interval: lo={lo!r}, hi={hi!r}; lo <= hi is needed, or NaN for a "
        "missing sample, and infinity only as an unbounded side"
    )
