"""Set inversion by branch and bound (SIVIA: Jaulin and Walter, 1993)."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.progress import Progress

from eskin.design.paving import Paving, Region
from eskin.design.preconditions import require_bounded
from eskin.errors import DesignError
from eskin.interval import Interval, require_plain

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray
    from rich.console import Console

    from eskin.design.paving import Floats
    from eskin.design.requirement import Requirement


@contextmanager
def progress_bar(
    title: str = "inverting", *, console: Console | None = None
) -> Iterator[Callable[[float], None]]:
    """Show a bar while the block runs; what it gives goes to `invert` as ``progress``.

    Args:
        title: What stands before the bar.
        console: Where to show it; the terminal or notebook by default.
    """
    with Progress(console=console) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)


_AT_ONCE: Final = 16_384
"""Boxes judged together: many enough for vectors, few enough for the cache."""


def invert(
    requirement: Requirement,
    space: Mapping[str, Interval],
    *,
    resolution: float = 1 / 64,
    most: int = 1_000_000,
    progress: Callable[[float], None] = lambda _share: None,
) -> Paving:
    """Find the parameters that meet a requirement.

    Args:
        requirement: What has to hold.
        space: Each parameter's interval: bounded, and not thin.
        resolution: Boxes whose every side is this share of the space's side are not divided any
            further; undecided, they are possible.
        most: Most boxes of the answer; beyond it, what is left undecided is possible.
        progress: Called with the share of the volume that is done, from 0 to 1.

    Returns:
        Boxes that certainly meet it, possibly, and never.

    Raises:
        DesignError: The space or the resolution cannot be used.
    """
    names, lo, hi = _corners(space)
    require_plain(resolution, "resolution", DesignError)
    if not 0.0 < resolution <= 1.0:
        raise DesignError(f"resolution: {resolution} is outside of (0, 1]")
    open_boxes = [(lo[None, :], hi[None, :])]
    settled: list[tuple[Floats, Floats, NDArray[np.str_]]] = []
    count, done = 0, 0.0
    while open_boxes:
        low, high = open_boxes.pop()
        if len(low) > _AT_ONCE:
            open_boxes.append((low[_AT_ONCE:], high[_AT_ONCE:]))
            low, high = low[:_AT_ONCE], high[:_AT_ONCE]
        regions = _judge(requirement, names, low, high)
        sides = (high - low) / (hi - lo)
        closed = (regions != Region.POSSIBLE) | (sides.max(axis=1) <= resolution)
        waiting = sum(len(each[0]) for each in open_boxes) + len(low)
        if count + waiting + int(np.count_nonzero(~closed)) > most:
            closed[:] = True
        settled.append((low[closed], high[closed], regions[closed]))
        count += int(np.count_nonzero(closed))
        done += float(np.sum(np.prod(sides[closed], axis=1)))
        progress(min(done, 1.0))
        if not closed.all():
            open_boxes.append(_halves(low[~closed], high[~closed], sides[~closed]))
    progress(1.0)
    low, high, regions = (np.concatenate(part) for part in zip(*settled, strict=True))
    return Paving(dict(space), low, high, regions)


def _judge(
    requirement: Requirement, names: list[str], low: Floats, high: Floats
) -> NDArray[np.str_]:
    boxes = {name: Interval(low[:, k], high[:, k]) for k, name in enumerate(names)}
    judged = requirement.judge(boxes)
    undecided = np.where(judged.impossible, Region.NEVER, Region.POSSIBLE)
    return np.where(judged.certain, Region.CERTAIN, undecided)


def _halves(low: Floats, high: Floats, sides: Floats) -> tuple[Floats, Floats]:
    """Divide each box at the middle of its longest side."""
    rows = np.arange(len(low))
    widest = sides.argmax(axis=1)
    middle = 0.5 * low[rows, widest] + 0.5 * high[rows, widest]
    left, right = high.copy(), low.copy()
    left[rows, widest] = middle
    right[rows, widest] = middle
    return np.concatenate([low, right]), np.concatenate([left, high])


def _corners(space: Mapping[str, Interval]) -> tuple[list[str], Floats, Floats]:
    if not space:
        raise DesignError("the space has no parameter; give at least one interval")
    for name, value in space.items():
        require_bounded(name, value)
        if value.inf >= value.sup:
            raise DesignError(f"{name}: {value!r} is thin; a parameter to choose needs lo < hi")
    lo = np.array([float(value.inf) for value in space.values()])
    hi = np.array([float(value.sup) for value in space.values()])
    return list(space), lo, hi
