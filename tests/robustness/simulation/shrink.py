"""Find the few faults that break a law: delta debugging (Zeller and Hildebrandt, 2002)."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tests.robustness.simulation.faults import Fault


def shrink(faults: Sequence[Fault], fails: Callable[[Sequence[Fault]], bool]) -> list[Fault]:
    """Remove faults as long as what is left still fails; none of the result can be spared.

    Args:
        faults: With these it fails.
        fails: Whether it fails with some of them.
    """
    left = list(faults)
    parts = 2
    while left:
        size = -(-len(left) // parts)
        for begin in range(0, len(left), size):
            without = left[:begin] + left[begin + size :]
            if fails(without):
                left, parts = without, max(2, parts - 1)
                break
        else:
            if size == 1:
                break
            parts = min(2 * parts, len(left))
    return left
