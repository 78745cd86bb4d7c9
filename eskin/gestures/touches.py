"""Touches over time: what is certain of each, and how far it may reach.

A *bundle* is a component of the possibly pressed taxels over time, a *touch* here one of the
certainly pressed ones: it stands for the true touch that holds it, which lies within its bundle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, Self, TypeVar

import numpy as np

from eskin.contacts.measures import bound_centroids

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from eskin.contacts import Skin
    from eskin.contacts.components import Indices
    from eskin.interval import Floats

MOST_BLOCKS = 1024
"""Blocks of instants for which a bundle keeps places: the block doubles when there are more."""


@dataclass(slots=True, eq=False)
class Bundle:
    """Possibly pressed taxels that hang together in space and time.

    Attributes:
        first: Its first sample.
        last: Its last one.
        begin: Earliest instant of the first, ns.
        end: Latest instant of the last.
        open_begin: Whether it may have begun before the record.
        open_end: Whether it may end after the record.
        places: For each block of ``2**shift`` samples a box, shape ``(2, d)``, that holds its
            taxels; centroids of touches lie in it.
        shift: Logarithm of the length of a block.
        touches: The touches within.
        given_up: Whether there was another one, which is not waited for.
    """

    first: int
    last: int
    begin: int
    end: int
    open_begin: bool = False
    open_end: bool = False
    places: dict[int, Floats] = field(default_factory=dict)
    shift: int = 0
    touches: list[Touch] = field(default_factory=list)
    given_up: bool = False
    gone: Bundle | None = None

    def absorb(self, other: Bundle) -> None:
        """Become one with another, which is gone then."""
        while self.shift != other.shift:
            (self if self.shift < other.shift else other).coarsen()
        for one, two in ((self, other), (other, self)):
            for touch in one.touches:
                for block in touch.places.keys() & two.places.keys():
                    touch.places[block] = hull(touch.places[block], two.places[block])
        for block, box in other.places.items():
            own = self.places.get(block)
            self.places[block] = box if own is None else hull(own, box)
        self.first, self.last = min(self.first, other.first), max(self.last, other.last)
        self.begin, self.end = min(self.begin, other.begin), max(self.end, other.end)
        self.open_begin |= other.open_begin
        self.open_end |= other.open_end
        self.given_up |= other.given_up
        for touch in other.touches:
            touch.bundle = self
        self.touches += other.touches
        other.gone = self

    def coarsen(self) -> None:
        """Double the length of a block, of this and of all touches within."""
        for touch in self.touches:
            coarse: dict[int, Floats] = {}
            for block in {fine >> 1 for fine in touch.places}:
                parts = [touch.box(self, fine) for fine in (2 * block, 2 * block + 1)]
                coarse[block] = hull(*(part for part in parts if part is not None))
            touch.places = coarse
        wide: dict[int, Floats] = {}
        for fine, box in self.places.items():
            own = wide.get(fine >> 1)
            wide[fine >> 1] = box if own is None else hull(own, box)
        self.places = wide
        self.shift += 1

    def reach(self, sample: int, end: int, box: Floats) -> None:
        """Go on at a sample, which the touches that are pressed have already as their last."""
        while len(self.places) >= MOST_BLOCKS and sample >> self.shift not in self.places:
            self.coarsen()
        self.last, self.end = sample, end
        block = sample >> self.shift
        own = self.places.get(block)
        self.places[block] = box if own is None else hull(own, box)
        for touch in self.touches:
            if touch.last < sample and block in touch.places:
                touch.places[block] = hull(touch.places[block], box)

    def boxes(self, first: int, last: int, touch: Touch | None = None) -> Floats:
        """Boxes of all samples from one to another, of a touch within or of all."""
        blocks = range(first >> self.shift, (last >> self.shift) + 1)
        if touch is None:
            return np.stack([self.places[block] for block in blocks])
        return np.stack([touch.places.get(block, self.places[block]) for block in blocks])


@dataclass(slots=True, eq=False)
class Touch:
    """Certainly pressed taxels that hang together in space and time.

    Attributes:
        first: Their first sample.
        last: Their last one.
        begin: Latest instant of the first, ns.
        end: Earliest instant of the last.
        contact: Lowest label of their contacts.
        bundle: The bundle around.
        places: For each block of samples a box that holds the true touch's centroids; where there
            is none, the bundle's does.
    """

    first: int
    last: int
    begin: int
    end: int
    contact: int
    bundle: Bundle
    places: dict[int, Floats] = field(default_factory=dict)
    gone: Touch | None = None

    def absorb(self, other: Touch) -> None:
        """Become one with another of the same bundle: what holds for either holds for both."""
        for block, box in other.places.items():
            own = self.places.get(block)
            self.places[block] = box if own is None else common(own, box)
        self.first, self.last = min(self.first, other.first), max(self.last, other.last)
        self.begin, self.end = min(self.begin, other.begin), max(self.end, other.end)
        self.contact = min(self.contact, other.contact)
        self.bundle.touches.remove(other)
        other.gone = self

    def box(self, bundle: Bundle, block: int) -> Floats | None:
        """Its box in a block, or its bundle's, or none where the bundle is not."""
        return self.places.get(block, bundle.places.get(block))

    def reach(self, sample: int, box: Floats) -> None:
        """Go on at a sample, at which its bundle is already."""
        block = sample >> self.bundle.shift
        own = self.places.get(block)
        if own is not None:
            box = hull(own, box)
        elif max(block << self.bundle.shift, self.bundle.first) < sample:
            box = hull(self.bundle.places[block], box)  # earlier samples of the block
        self.places[block] = box


class _Merging(Protocol):
    """What may become one with another."""

    gone: Self | None

    def absorb(self, other: Self) -> None: ...


Merging = TypeVar("Merging", bound=_Merging)


def root(each: Merging) -> Merging:
    """What something has become."""
    while each.gone is not None:
        each = each.gone
    return each


def follow(
    before: Sequence[Merging],
    pairs: Indices,
    count: int,
    make: Callable[[int], Merging],
) -> list[Merging]:
    """What the components of an instant belong to.

    Args:
        before: What those of the instant before belong to.
        pairs: Components of both instants that share a taxel, shape ``(m, 2)``.
        count: Number of components at the instant.
        make: Makes what a component begins.
    """
    found: list[Merging | None] = [None] * count
    for earlier, later in pairs.tolist():
        each, own = root(before[earlier]), found[later]
        own = each if own is None else root(own)
        if own is not each:
            own.absorb(each)
        found[later] = own
    made = [make(k) if each is None else each for k, each in enumerate(found)]
    return [root(each) for each in made]


def shared(one: Indices, two: Indices) -> Indices:
    """Pairs of labels that a taxel has at two instants, ascending, shape ``(m, 2)``."""
    both = (one >= 0) & (two >= 0)
    if not both.any():
        return np.empty((0, 2), np.int64)
    count = int(two.max()) + 1
    codes = np.unique(one[both] * count + two[both])
    return np.stack([codes // count, codes % count], axis=1)


def boxes_of(labels: Indices, count: int, skin: Skin) -> Floats:
    """The box around the taxels of each label, shape ``(count, 2, d)``."""
    inside = np.flatnonzero(labels >= 0)
    boxes = np.empty((count, 2, skin.dimensions))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    np.minimum.at(boxes[:, 0], labels[inside], skin.positions[inside])
    np.maximum.at(boxes[:, 1], labels[inside], skin.positions[inside])
    return boxes


def centroids_of(cores: Indices, regions: Indices, region_of_core: Indices, skin: Skin) -> Floats:
    """The box of the centroids of all sets between each core and its region, ``(count, 2, d)``."""
    boxes = np.empty((region_of_core.size, 2, skin.dimensions))
    bounds = np.empty(region_of_core.size)
    for axis in range(skin.dimensions):
        coordinates = np.ascontiguousarray(skin.positions[:, axis])
        rising = skin.by_coordinate(axis)
        for side, order, sign in ((0, rising, -1.0), (1, rising[::-1].copy(), 1.0)):
            bound_centroids(
                coordinates, order, skin.area, regions, cores, region_of_core, sign, bounds
            )
            boxes[:, side, axis] = bounds
    return boxes


def hull(first: Floats, *others: Floats) -> Floats:
    """The box around a few boxes."""
    box = first.copy()
    for each in others:
        np.minimum(box[0], each[0], out=box[0])
        np.maximum(box[1], each[1], out=box[1])
    return box


def around(boxes: Floats) -> Floats:
    """The box around many boxes, of shape ``(m, 2, d)``."""
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def common(one: Floats, two: Floats) -> Floats:
    """What two boxes share."""
    return np.stack([np.maximum(one[0], two[0]), np.minimum(one[1], two[1])])
