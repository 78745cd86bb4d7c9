"""For how long a state surely holds, and surely not, wherever samples' true moments lie."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eskin_cloud.query.predicate import Verdict

if TYPE_CHECKING:
    from eskin_cloud.query.segments import Segment


class OccupancyBounds:
    """The time of each answer that no clock within the samples' time errors takes away, run by run.

    Sample k is told at ``t_k`` and was taken at some ``s_k`` in ``[t_k - e_k, t_k + e_k]``; samples
    were taken in the order of ``t``. It holds from ``s_k`` until ``s_(k+1)``; before a gap, for
    ``dt_k`` at most. Let samples i to j be a stretch: all with one answer, no gap between them, and
    let it end, as told, at ``h``: at ``t_(j+1)`` or ``t_j + dt_j``, whichever is earlier, or with
    the window. Then in truth one of them holds from ``s_i`` until ``s_(j+1)`` if no gap follows,
    else until ``s_j + dt_j`` or ``s_(j+1)``, whichever is earlier. These moments are

    - ``t_i + e_i`` at the latest,
    - ``min(t_j + dt_j - e_j, t_(j+1) - e_(j+1))`` at the earliest.

    What lies between both, and before ``h``, surely has that answer. It is the stretch as told
    without ``e_i`` at its begin, and without what comes after the second moment at its end; so it
    lies within what is known. A stretch that is certain is in the state for so long at least, one
    that is impossible is not in it for so long at least, and all else that is known is possible.
    Where clocks err by nothing, nothing is lost. Of samples that are told outside of the window
    nothing was used but their order.

    Attributes:
        known: ns of which, by the moments as told, something is known.
    """

    def __init__(self) -> None:
        self.known = 0
        self._sure = [0, 0, 0]
        self._answer: Verdict | None = None
        self._current = self._lost = 0

    @property
    def time(self) -> tuple[int, int]:
        """In the state for so many ns, at least and at most, of those that are known."""
        return self._sure[Verdict.CERTAIN], self.known - self._sure[Verdict.IMPOSSIBLE]

    def add(self, run: Segment, end: int, following: int | None) -> None:
        """Go on by a run, which has no gap inside unless it is impossible.

        Where an impossible one has gaps, nothing holds in them that is in the state either.

        Args:
            run: The run.
            end: Where it ends at the latest, by the moments as told.
            following: The earliest true moment of the next sample; ``None`` if there is none.
        """
        if run.answer is not self._answer:
            self.part()
            self._answer, self._current = run.answer, -run.error
        told = run.end + max(0, min(end - run.end, run.dt))
        earliest = run.end + run.dt - run.error
        earliest = earliest if following is None else min(earliest, following)
        self._lost = max(0, told - earliest)
        self._current += run.held + told - run.end
        self.known += run.held + told - run.end

    def part(self) -> None:
        """Close a stretch: behind a gap a new one begins."""
        if self._answer is not None:
            self._sure[self._answer] += max(0, self._current - self._lost)
        self._answer = None
