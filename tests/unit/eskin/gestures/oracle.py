"""What the templates say of a truth that is known exactly, by plain Python and fractions.

A truth is a list of instants, each a time in whole ns and a set of pressed taxels. Nothing here
is shared with what it tests, except the constants of the templates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from eskin.contacts import Skin
    from eskin.gestures import Templates

    Place = tuple[Fraction, ...]

_NS: Final = 10**9


@dataclass(frozen=True)
class Touch:
    """Pressed taxels that hang together in space and time.

    Attributes:
        cells: Pairs of instant and taxel.
        first: First instant.
        last: Last one.
        places: The centroid at each instant.
    """

    cells: frozenset[tuple[int, int]]
    first: int
    last: int
    places: dict[int, Place]


@dataclass(frozen=True)
class Found:
    """A gesture of a truth: its kind, touches, first and last instant, angle and scale."""

    kind: str
    touches: tuple[Touch, ...]
    first: int
    last: int
    direction: float | None = None
    angle: float | None = None
    scale: float | None = None


class Truth:
    """Finds the touches and the gestures of a truth.

    Args:
        skin: Its taxels.
        instants: Of each instant, in ns.
        pressed: At each instant, the pressed taxels.
        templates: The constants; ``None``: only touches are sought.
    """

    def __init__(
        self,
        skin: Skin,
        instants: Sequence[int],
        pressed: Sequence[frozenset[int]],
        templates: Templates | None = None,
    ) -> None:
        self._instants, self._pressed = instants, pressed
        starts, others = skin.starts.tolist(), skin.neighbours.tolist()
        self._near = [others[starts[k] : starts[k + 1]] for k in range(len(skin))]
        self._positions = [tuple(map(Fraction, row)) for row in skin.positions.tolist()]
        self._areas = [Fraction(area) for area in skin.area.tolist()]
        self.touches = list(self._touches())
        self.gestures: list[Found] = []
        if templates is not None:
            self._templates = templates
            self.gestures = [*self._alone(), *self._together()]

    def _touches(self) -> Iterator[Touch]:
        left = {(k, taxel) for k, each in enumerate(self._pressed) for taxel in each}
        while left:
            front = [left.pop()]
            cells = set(front)
            while front:
                k, taxel = front.pop()
                around = [(k, other) for other in self._near[taxel]]
                for cell in [*around, (k - 1, taxel), (k + 1, taxel)]:
                    if cell in left:
                        left.remove(cell)
                        cells.add(cell)
                        front.append(cell)
            yield self._touch(cells)

    def _touch(self, cells: set[tuple[int, int]]) -> Touch:
        instants: dict[int, list[int]] = {}
        for k, taxel in cells:
            instants.setdefault(k, []).append(taxel)
        places = {k: self._centroid(taxels) for k, taxels in instants.items()}
        return Touch(frozenset(cells), min(instants), max(instants), places)

    def _centroid(self, taxels: Sequence[int]) -> Place:
        area = sum(self._areas[k] for k in taxels)
        rows = zip(*([x * self._areas[k] for x in self._positions[k]] for k in taxels), strict=True)
        return tuple(sum(row, Fraction()) / area for row in rows)

    def kind_of(self, touch: Touch) -> str | None:
        """The kind of one touch."""
        t = self._templates
        lasts = self._instants[touch.last] - self._instants[touch.first]
        columns = list(zip(*touch.places.values(), strict=True))
        if max(max(column) - min(column) for column in columns) <= Fraction(t.still_m):
            if lasts <= t.tap_ns:
                return "tap"
            return "hold" if lasts >= t.hold_ns else "press"
        way = _minus(touch.places[touch.last], touch.places[touch.first])
        far = _dot(way, way)
        if far < Fraction(t.slide_m) ** 2:
            return None
        least = Fraction(t.swipe_m_per_s) * lasts / _NS
        return "swipe" if far >= least**2 else "slide"

    def _alone(self) -> Iterator[Found]:
        for touch in self.touches:
            kind = self.kind_of(touch)
            if kind is not None:
                way = _minus(touch.places[touch.last], touch.places[touch.first])
                direction = _angle(way) if kind in {"slide", "swipe"} else None
                yield Found(kind, (touch,), touch.first, touch.last, direction)

    def _together(self) -> Iterator[Found]:
        for number, one in enumerate(self.touches):
            for two in self.touches[:number]:
                if one.last < two.first:
                    yield from self._double_tap(one, two)
                elif two.last < one.first:
                    yield from self._double_tap(two, one)
                else:
                    yield from self._pair(one, two)

    def _double_tap(self, first: Touch, second: Touch) -> Iterator[Found]:
        if self.kind_of(first) != "tap" or self.kind_of(second) != "tap":
            return
        t = self._templates
        pause = self._instants[second.first] - self._instants[first.last]
        way = _minus(second.places[second.first], first.places[first.first])
        if pause <= t.pause_ns and _dot(way, way) <= Fraction(t.apart_m) ** 2:
            yield Found("double tap", (first, second), first.first, second.last)

    def _pair(self, one: Touch, two: Touch) -> Iterator[Found]:
        t = self._templates
        first, last = max(one.first, two.first), min(one.last, two.last)
        if self._instants[last] - self._instants[first] < t.together_ns:
            return
        was = _minus(two.places[first], one.places[first])
        became = _minus(two.places[last], one.places[last])
        before, after = _dot(was, was), _dot(became, became)
        if max(before, after) > Fraction(t.span_m) ** 2 or not before or not after:
            # At no distance there is no angle, and no factor between two such.
            if max(before, after) <= Fraction(t.span_m) ** 2 and before != after:
                yield Found("pinch" if before else "spread", (one, two), first, last)
            return
        turn = _angle(became) - _angle(was)
        scale = math.sqrt(after / before)
        factor = Fraction(t.scale) ** 2
        kind: str | None = None
        if after * factor <= before:
            kind = "pinch"
        elif after >= before * factor:
            kind = "spread"
        else:
            x, y = was[0], was[1] if len(was) > 1 else Fraction()
            u, v = became[0], became[1] if len(became) > 1 else Fraction()
            dot, cross = x * u + y * v, x * v - y * u
            if dot < 0 or (cross and 3 * cross**2 >= dot**2):
                kind = "rotation"
        if kind is not None:
            yield Found(kind, (one, two), first, last, angle=turn, scale=scale)


def _minus(one: Place, two: Place) -> Place:
    return tuple(x - y for x, y in zip(one, two, strict=True))


def _dot(one: Place, two: Place) -> Fraction:
    return sum((x * y for x, y in zip(one, two, strict=True)), Fraction())


def _angle(way: Place) -> float:
    return math.atan2(way[1] if len(way) > 1 else 0, way[0])
