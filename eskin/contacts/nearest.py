"""Which label each new core takes: the nearest, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from eskin.kernels.jit import kernel

if TYPE_CHECKING:
    from eskin.contacts.components import Indices
    from eskin.interval import Floats


@kernel
def choose_nearest(
    places: Floats,
    list_of: Indices,
    starts: Indices,
    candidates: Indices,
    candidate_places: Floats,
    chosen: Indices,
) -> None:
    """Choose the nearest candidate of each place, in order, each candidate once.

    Args:
        places: Positions, (m, d).
        list_of: Which list of candidates each place chooses from, (m,).
        starts: Where each list starts in ``candidates``, and where the last ends.
        candidates: Numbers of candidates; of equally near ones the first of a list is chosen.
        candidate_places: Positions by number, (k, d).
        chosen: Receives a number for each place, -1 where no candidate is left, (m,).
    """
    free = np.ones(len(candidate_places), np.bool_)
    for k in range(len(places)):
        best, least = -1, math.inf
        for at in range(starts[list_of[k]], starts[list_of[k] + 1]):
            number = candidates[at]
            if not free[number]:
                continue
            distance = 0.0
            for axis in range(places.shape[1]):
                distance += (candidate_places[number, axis] - places[k, axis]) ** 2
            if best < 0 or distance < least:
                best, least = number, distance
        chosen[k] = best
        if best >= 0:
            free[best] = False
