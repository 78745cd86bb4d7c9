"""Time windows of queries: ``start`` included, ``end`` excluded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from eskin.errors import QueryError
from eskin.wire.timestamp import MOST_INSTANT, SECOND, format_timestamp, parse_timestamp

DEFAULT_SPAN: Final = 60 * SECOND
_MAX_SPAN: Final = 2**62


@dataclass(frozen=True, slots=True)
class Window:
    """A half-open time window.

    Attributes:
        start: UTC ns, included.
        end: UTC ns, excluded.
    """

    start: int
    end: int

    @property
    def span(self) -> int:
        """Its length in ns."""
        return self.end - self.start


def parse_time(parameter: str, text: str | None) -> int | None:
    """Parse a time.

    Raises:
        QueryError: The text is no time, or outside of 64 bits.
    """
    if text is None:
        return None
    try:
        instant = parse_timestamp(text)
    except ValueError as error:
        raise QueryError(parameter, str(error)) from error
    if abs(instant) > MOST_INSTANT:
        raise QueryError(parameter, f"{text!r} is outside of the years 1678 to 2262")
    return instant


def parse_window(start: str | None, end: str | None, *, last: int) -> Window:
    """Parse a window; by default the last minute of data.

    Args:
        start: Text of the start.
        end: Text of the end.
        last: Time of the latest sample, UTC ns.

    Raises:
        QueryError: A time is invalid, ``start`` is after ``end``, or they are too far apart.
    """
    begin, finish = parse_time("start", start), parse_time("end", end)
    if finish is None:
        finish = (
            min(last + 1, MOST_INSTANT)
            if begin is None
            else max(begin, min(last + 1, MOST_INSTANT))
        )
    if begin is None:
        begin = max(finish - DEFAULT_SPAN, -MOST_INSTANT)
    return make_window(begin, finish)


def make_window(start: int, end: int) -> Window:
    """Create a window, and check it.

    Raises:
        QueryError: ``start`` is after ``end``, or they are too far apart.
    """
    require_ordered(start, end)
    if end - start > _MAX_SPAN:
        raise QueryError("start", "is more than 146 years before end; choose a shorter window")
    return Window(start, end)


def require_ordered(start: int | None, end: int | None) -> None:
    """Reject a window that ends before it starts.

    Raises:
        QueryError: ``start`` is after ``end``.
    """
    if start is not None and end is not None and start > end:
        raise QueryError(
            "start",
            f"{format_timestamp(start)} is after end, {format_timestamp(end)}; swap them, or leave "
            "one out",
        )


def before(instant: int, span: int) -> int:
    """A time minus a span, UTC ns, limited to 64 bits."""
    return max(instant - span, -(2**63))


def clip(t: int, dt: int, n: int, window: Window) -> tuple[int, int]:
    """The first and the last index of a run's samples in a window; last < first if none."""
    return max(0, -((t - window.start) // dt)), min(n - 1, (window.end - 1 - t) // dt)
