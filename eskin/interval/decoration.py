"""Where functions were evaluated outside of their domains: IEEE 1788-2015, clause 11.

The standard decorates every result: ``def`` where the function was defined on the whole interval,
``trv`` where that is not known. Here a watch notes it beside the results, while it is open, so that
it holds of whatever a caller makes of them.
"""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from eskin.interval.bounds import Bounds


class DomainWatch:
    """Which rows hold a point at which some function was not defined, at most.

    Attributes:
        undefined: One truth a row.
    """

    def __init__(self, rows: int) -> None:
        self.undefined: NDArray[np.bool_] = np.zeros(rows, dtype=bool)

    def note(self, outside: NDArray[np.bool_]) -> None:
        """Note where arguments reach outside of a domain.

        Shape ``(rows, m)`` names the row; any other shape counts for all rows.
        """
        if outside.ndim == 2 and len(outside) == len(self.undefined):
            self.undefined |= outside.any(axis=1)
        elif outside.any():
            self.undefined[:] = True


_WATCH: ContextVar[DomainWatch | None] = ContextVar("domain_watch", default=None)


@contextmanager
def watch_domains(rows: int) -> Iterator[DomainWatch]:
    """Watch what this thread evaluates until the end of the ``with`` statement.

    Args:
        rows: How many boxes are evaluated at once, along the first of two axes.
    """
    watch = DomainWatch(rows)
    token = _WATCH.set(watch)
    try:
        yield watch
    finally:
        _WATCH.reset(token)


def undefined_where(outside: Callable[[], NDArray[np.bool_]]) -> None:
    """Tell the open watch, if there is one, where arguments reach outside of a domain."""
    watch = _WATCH.get()
    if watch is not None:
        watch.note(np.asarray(outside()))


def holds_zero(x: Bounds) -> NDArray[np.bool_]:
    """Whether 0 is a member of each."""
    return np.asarray((x.inf <= 0.0) & (x.sup >= 0.0))
