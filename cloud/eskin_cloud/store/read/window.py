"""The window of a question: from ``start`` up to, and without, ``end``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from eskin.errors import QueryError
from eskin.wire.timestamp import MOST_MOMENT, SECOND, parse_timestamp

DEFAULT_SPAN: Final = 60 * SECOND
_LONGEST: Final = 2**62


@dataclass(frozen=True, slots=True)
class Window:
    """A half-open stretch of time.

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


def read_moment(parameter: str, text: str | None) -> int | None:
    """Read a time of a question.

    Raises:
        QueryError: It is none, or outside of what 64 bit hold.
    """
    if text is None:
        return None
    try:
        moment = parse_timestamp(text)
    except ValueError as error:
        raise QueryError(parameter, str(error)) from error
    if abs(moment) > MOST_MOMENT:
        raise QueryError(parameter, f"{text!r} is outside of the years 1678 to 2262")
    return moment


def read_window(start: str | None, end: str | None, *, last: int) -> Window:
    """Read a window; what is left out makes it the last minute of data.

    Args:
        start: As asked.
        end: As asked.
        last: The latest sample's moment, UTC ns.

    Raises:
        QueryError: A time is none, ``start`` is after ``end``, or they are too far apart.
    """
    begin, finish = read_moment("start", start), read_moment("end", end)
    if finish is None:
        finish = (
            min(last + 1, MOST_MOMENT) if begin is None else max(begin, min(last + 1, MOST_MOMENT))
        )
    if begin is None:
        begin = max(finish - DEFAULT_SPAN, -MOST_MOMENT)
    return make_window(begin, finish)


def make_window(start: int, end: int) -> Window:
    """Check a window.

    Raises:
        QueryError: ``start`` is after ``end``, or they are too far apart.
    """
    require_order(start, end)
    if end - start > _LONGEST:
        raise QueryError("start", "is more than 146 years before end; ask for less at once")
    return Window(start, end)


def require_order(start: int | None, end: int | None) -> None:
    """Refuse a window that ends before it starts.

    Raises:
        QueryError: It does.
    """
    if start is not None and end is not None and start > end:
        raise QueryError("start", "is after end; swap them")
