"""Which taxels of a skin are stuck or dead, from what they measured.

Over a window of samples a tube tells two things for certain: how far its quantity moved at least
(``max lo - min hi``), and how far it can have moved at most (``max hi - min lo``). A contact does
not leave out a taxel in its middle: one that stays still while all around it move is stuck. Each
verdict has three values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.interval import Answer, Interval
from sensor_node.skin.skin import NOBODY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sensor_node.skin.skin import Indices


@dataclass(frozen=True, slots=True)
class Health:
    """What is known of each taxel of a skin after a window.

    Attributes:
        dead: Certain where every sample was unbounded on a side, impossible where none was.
        stuck: Certain where it stayed within ``still`` while all of its neighbours certainly moved;
            impossible where it certainly moved itself; possible otherwise.
        moved: By how much it moved, as an interval in the quantity's unit.
    """

    dead: Answer
    stuck: Answer
    moved: Interval


def examine(values: Interval, neighbours: Indices, *, still: float, moves: float) -> Health:
    """Examine a window.

    Args:
        values: What was measured, taxels × samples; missing samples are unbounded on both sides.
        neighbours: Table of neighbours, one row a taxel.
        still: A taxel that stays within this range (in the quantity's unit) is constant; it is at
            least as wide as its tube, or nothing is ever certain.
        moves: What a neighbour must have moved at least.

    Returns:
        One answer a taxel. Dead neighbours are passed over; a taxel without any other is never
        certainly stuck.
    """
    unbounded = ~values.is_common_interval
    known = np.any(~unbounded, axis=1)
    dead = Answer(~known, ~np.any(unbounded, axis=1))
    moved = _movement(values, unbounded)
    lively = ~known | (moved.inf > moves)
    there = neighbours != NOBODY
    witnesses = there & known[neighbours]
    around = np.all(lively[neighbours] | ~there, axis=1) & np.any(witnesses, axis=1)
    constant = known & (moved.sup <= still)
    return Health(dead, Answer(constant & around, moved.inf > 0.0), moved)


def _movement(values: Interval, unbounded: NDArray[np.bool_]) -> Interval:
    """The range of each taxel's true values, as an interval."""
    least = values.inf.max(axis=1) - values.sup.min(axis=1)
    most = values.sup.max(axis=1) - values.inf.min(axis=1)
    open_range = np.any(unbounded, axis=1)
    return Interval(
        np.maximum(np.nextafter(least, -np.inf), 0.0),
        np.where(open_range, np.inf, np.nextafter(most, np.inf)),
    )
