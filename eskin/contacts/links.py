"""Which contacts of two consecutive instants share a taxel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Verdict

if TYPE_CHECKING:
    from eskin.contacts.components import Indices
    from eskin.contacts.contacts import Contacts


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """Links between the contacts of two instants: whether they share a taxel.

    Attributes:
        earlier: The contacts of the first instant.
        later: The contacts of the second.
        cores: Certain links: number of the earlier core, of the later core, and of the taxels that
            both hold, shape ``(m, 3)``, ascending.
        regions: Earlier and later regions that share a taxel, and how many, shape ``(k, 3)``,
            ascending. All other pairs of contacts have impossible links.
    """

    earlier: Contacts
    later: Contacts
    cores: Indices
    regions: Indices

    def verdict(self, earlier: int, later: int) -> Verdict:
        """Whether the contacts of two cores share a taxel.

        That is certain if the cores do, impossible if their regions do not, and possible otherwise.

        Raises:
            IndexError: There is no core of this number.
        """
        one, two = range(len(self.earlier))[earlier], range(len(self.later))[later]
        if _has(self.cores, one, two):
            return Verdict.CERTAIN
        around = self.earlier.table["region"][one], self.later.table["region"][two]
        return Verdict.POSSIBLE if _has(self.regions, *around) else Verdict.IMPOSSIBLE


def link_contacts(earlier: Contacts, later: Contacts) -> Links:
    """Link the contacts of two consecutive instants of one skin.

    Raises:
        IntervalError: They have different numbers of taxels.
    """
    if earlier.core_of.shape != later.core_of.shape:
        raise IntervalError(
            f"contacts of {earlier.core_of.size} and of {later.core_of.size} taxels; link those of "
            "one skin"
        )
    return Links(
        earlier,
        later,
        _overlaps(earlier.core_of, later.core_of, len(later)),
        _overlaps(earlier.region_of, later.region_of, len(later.regions)),
    )


def _overlaps(one: Indices, two: Indices, count: int) -> Indices:
    both = (one >= 0) & (two >= 0)
    codes, shared = np.unique(one[both] * count + two[both], return_counts=True)
    return np.stack([codes // max(count, 1), codes % max(count, 1), shared], axis=1)


def _has(pairs: Indices, one: int, two: int) -> bool:
    return bool(np.any((pairs[:, 0] == one) & (pairs[:, 1] == two)))
