"""Episodes: from a verdict that raises an alarm until the formula is impossible for long enough."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from eskin.interval import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable


class VerdictStretch(NamedTuple):
    """A stretch with one verdict, in ticks: 2t is the instant t in ns, 2t + 1 just after it.

    Attributes:
        first: The first tick.
        last: The last one.
        verdict: What holds there.
        missing: Whether it is possible, and could hold by samples alone that do not exist.
    """

    first: int
    last: int
    verdict: Verdict
    missing: bool


class Edge(NamedTuple):
    """An episode begins, with the verdict that raises the alarm, or it ends.

    Attributes:
        tick: When: the first tick at which it raises, or at which the formula is impossible.
        verdict: ``None`` at an end.
    """

    tick: int
    verdict: Verdict | None


class Episodes:
    """Finds episodes in stretches that follow each other.

    An episode begins where the verdict is *certain*, or, if that is enough, *possible*. It ends
    where the formula has been impossible for `clear_after`. So two stretches that are nearer to
    each other are one episode, and missing samples end none.

    Args:
        on_possible: Whether *possible* is enough.
        missing: Whether it is where only samples that do not exist make it so.
        clear_after: In ns.
        is_open: Whether an episode goes on.
    """

    def __init__(
        self, *, on_possible: bool, missing: bool, clear_after: int, is_open: bool
    ) -> None:
        self._on_possible = on_possible
        self._missing = missing
        self._clear_after = clear_after
        self.is_open = is_open
        self._quiet: int | None = None

    @property
    def quiet(self) -> int | None:
        """Since when the formula is impossible, while an episode goes on."""
        return self._quiet

    def add(self, stretches: Iterable[VerdictStretch]) -> list[Edge]:
        """Add the stretches that come next; returns where episodes begin and end."""
        found = []
        for each in stretches:
            if self._raises(each):
                self._quiet = None
                if not self.is_open:
                    self.is_open = True
                    found.append(Edge(each.first, each.verdict))
            elif each.verdict is not Verdict.IMPOSSIBLE:
                self._quiet = None
            elif self.is_open:
                self._quiet = each.first if self._quiet is None else self._quiet
                if each.last + 1 - self._quiet >= 2 * self._clear_after:
                    found.append(Edge(self._quiet, None))
                    self.is_open, self._quiet = False, None
        return found

    def _raises(self, stretch: VerdictStretch) -> bool:
        if stretch.verdict is Verdict.POSSIBLE:
            return self._on_possible and (self._missing or not stretch.missing)
        return stretch.verdict is Verdict.CERTAIN
