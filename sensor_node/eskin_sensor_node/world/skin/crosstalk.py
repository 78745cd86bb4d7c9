"""What a taxel feels of its neighbours: linear, with coefficients that are known by a bound only.

``felt_i = pressure_i + k_i · mean of its neighbours' pressure``, ``0 ≤ k_i ≤ crosstalk``: the layer
of skin over the taxels hands pressure on sideways.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from eskin.interval import Interval
from eskin_sensor_node.world.skin.skin import NO_NEIGHBOUR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eskin.interval import Floats
    from eskin_sensor_node.world.skin.skin import Indices, Skin

_STREAM: Final = 0x6B
"""Separates the draws of coefficients from others of the same seed."""
_ROUNDS: Final = 6


@dataclass(frozen=True, slots=True)
class Crosstalk:
    """True coefficients of a skin.

    Attributes:
        neighbours: Table of neighbours, (n, most).
        coefficients: One for each taxel.
    """

    neighbours: Indices
    coefficients: Floats

    @classmethod
    def draw(cls, skin: Skin, bound: float, seed: int) -> Self:
        """Draw coefficients from inside their bound."""
        random = np.random.default_rng((seed, _STREAM))
        return cls(skin.neighbours, random.uniform(0.0, bound, len(skin)))

    def among(self, places: Indices) -> LocalCrosstalk:
        """What some taxels feel of each other and of their neighbours."""
        around = self.neighbours[places]
        there = around != NO_NEIGHBOUR
        rows = np.union1d(places, around[there])
        return LocalCrosstalk(
            rows,
            np.searchsorted(rows, places),
            np.where(there, np.searchsorted(rows, around), len(rows)),
            self.coefficients[places] / np.maximum(there.sum(axis=1), 1),
        )


@dataclass(frozen=True, slots=True)
class LocalCrosstalk:
    """Crosstalk of some taxels.

    Attributes:
        rows: The taxels themselves and all whose force reaches them, ascending.
        places: Where the taxels are among these.
        around: Where their neighbours are; ``len(rows)`` where there is none.
        share: What each neighbour hands on to each taxel.
    """

    rows: Indices
    places: Indices
    around: Indices
    share: Floats

    def felt(self, pressure: Floats) -> Floats:
        """What the taxels feel, of the pressure on all rows, (rows, times)."""
        padded = np.concatenate([pressure, np.zeros((1, pressure.shape[1]))])
        total = np.zeros((len(self.places), pressure.shape[1]))
        for column in range(self.around.shape[1]):
            total += padded[self.around[:, column]]
        return np.asarray(pressure[self.places] + self.share[:, None] * total)


def unmix(
    felt: Interval, neighbours: Indices, *, bound: float, most: float, broken: Sequence[int] = ()
) -> Interval:
    """The taxels' own pressures out of what they feel, for all coefficients within the bound.

    ``p_i = felt_i - k·mean(p_j)`` holds for the true pressures, so cutting each with it never loses
    them; a few rounds make it about as tight as it gets (an interval Jacobi iteration, which
    contracts as the bound is at most one half).

    Args:
        felt: Of all taxels of the skin, (n, …).
        neighbours: The skin's table of neighbours.
        bound: The greatest coefficient.
        most: Greatest pressure that any contact makes, in Pa.
        broken: Taxels that are not to be believed: nothing is known of their pressure.

    Returns:
        The same shape, within ``[0, most]``; all of it where no such pressures explain what is
        felt.
    """
    there = neighbours != NO_NEIGHBOUR
    shape = (-1, *[1] * (felt.ndim - 1))
    count = np.maximum(there.sum(axis=1), 1).astype(np.float64).reshape(shape)
    coefficient = Interval(0.0, bound) / Interval(count)
    whole = Interval(np.zeros(felt.shape), np.full(felt.shape, most))
    own = whole
    for _ in range(_ROUNDS):
        total = Interval(np.zeros(felt.shape))
        for column in range(neighbours.shape[1]):
            present = there[:, column].astype(np.float64).reshape(shape)
            total = total + own[neighbours[:, column]] * present
        cut = own.intersection(felt - coefficient * total)
        believed = ~cut.is_empty
        believed[list(broken)] = False
        own = Interval(
            np.where(believed, cut.inf, whole.inf), np.where(believed, cut.sup, whole.sup)
        )
    return own
