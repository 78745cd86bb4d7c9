"""The contacts of a skin at one instant, from the frames of its pages."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from eskin.contacts import Skin, find_contacts

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from numpy.typing import NDArray

    from eskin.contacts import Contacts
    from eskin.interval import Floats
    from eskin.wire.frames import Frame, Patch, Sampling
    from eskin_cloud.store.descriptions import DescribedLayout

UNIT: Final = "Pa"
_MICROMETRE: Final = 1e6


class Pressures:
    """What is known of all taxels of a skin at one instant.

    Attributes:
        lo: Lower bounds, ``-inf`` where nothing is known, shape ``(n,)``.
        hi: Upper bounds.
        t: Middle of the latest sample's time, UTC ns; ``None`` without any sample.
    """

    def __init__(self, taxels: int) -> None:
        self.lo = np.full(taxels, -np.inf)
        self.hi = np.full(taxels, np.inf)
        self.t: int | None = None

    def put(self, place: slice, lo: Floats, hi: Floats, t: int) -> None:
        """State a patch's taxels."""
        self.lo[place], self.hi[place] = lo, hi
        self.t = t if self.t is None else max(self.t, t)


@dataclass(frozen=True, eq=False)
class ContactSkin:
    """The taxels of a layout that have contacts, in the order of its patches.

    These are the columns of patches in Pa that state a threshold and the area of a cell.

    Attributes:
        skin: Where they are, how large, and which are neighbours.
        taxels: Their names.
        threshold: Pressure above which each is pressed, Pa, shape ``(n,)``.
        places: Of each such patch, by its number in the layout, its taxels.
    """

    skin: Skin
    taxels: tuple[str, ...]
    threshold: Floats
    places: Mapping[int, slice]

    @classmethod
    def of(cls, described: DescribedLayout) -> Self | None:
        """The skin of a layout; ``None`` if no patch has contacts.

        Raises:
            ContactError: The patches describe none.
        """
        chosen = {
            number: patch
            for number, patch in enumerate(described.patches)
            if patch.threshold is not None and patch.cell_area is not None
            and patch.positions and patch.unit == UNIT
        }  # fmt: skip
        if not chosen:
            return None
        sizes = [len(patch.taxels) for patch in chosen.values()]
        begins = dict(zip(chosen, accumulate([0, *sizes]), strict=False))
        patches = chosen.values()
        edges = [
            (begins[number] + one, begins[number] + other)
            for number, patch in chosen.items()
            for one, other in patch.neighbours
        ]
        edges += [
            (begins[seam.first] + one, begins[seam.second] + other)
            for seam in described.layout.seams
            if seam.first in chosen and seam.second in chosen
            for one, other in seam.pairs
        ]
        return cls(
            Skin.from_edges(
                _positions(patches), np.repeat([patch.cell_area for patch in patches], sizes), edges
            ),
            tuple(taxel for patch in patches for taxel in patch.taxels),
            np.repeat([float(patch.threshold or 0) for patch in patches], sizes),
            {
                number: slice(begins[number], begins[number] + len(patch.taxels))
                for number, patch in chosen.items()
            },
        )

    def read_last(self, frames: Iterable[Frame]) -> Pressures:
        """The latest sample of each taxel in frames of one stretch."""
        found = Pressures(len(self.taxels))
        for frame in frames:
            middle = sum(frame.time) // 2
            for each, values in zip(frame.patches, frame.values, strict=True):
                place = self.places.get(each.patch)
                if place is None:
                    continue
                grid = frame.grids[each.grid]
                last = last_rows(each.sampling(grid))
                columns = np.arange(each.columns)
                lo = np.where(last < 0, -np.inf, values.inf[last, columns])
                hi = np.where(last < 0, np.inf, values.sup[last, columns])
                t = middle + grid.delay + int(last.max()) * grid.period
                found.put(place, lo, hi, t)
        return found

    def find(self, pressures: Pressures) -> Contacts:
        """The contacts at one instant."""
        least = float(self.threshold.min())
        # Where thresholds differ, bounds between the least and a taxel's own become the least, so
        # that they lie above the one exactly where they lay above the other.
        lo, hi = (
            np.where((bound > least) & (bound <= self.threshold), least, bound)
            for bound in (pressures.lo, pressures.hi)
        )
        return find_contacts(lo, hi, self.skin, least)


def last_rows(sampling: Sampling) -> NDArray[np.int64]:
    """The row of each column's last sample; -1 where it has none."""
    mask = sampling.mask
    last = sampling.rows - 1 - np.argmax(mask[::-1], axis=0)
    return np.where(mask.any(axis=0), last, -1)


def _positions(patches: Iterable[Patch]) -> Floats:
    """In m, shape ``(n, d)``; patches without z lie at z = 0 if others have one."""
    axes = max(len(patch.positions) for patch in patches)
    parts = [
        np.array([*patch.positions, *[(0,) * len(patch.taxels)] * (axes - len(patch.positions))])
        for patch in patches
    ]
    return np.concatenate(parts, axis=1).T / _MICROMETRE
