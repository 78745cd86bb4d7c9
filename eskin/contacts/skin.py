"""A skin as contacts need it: where its taxels are, how large, and which are neighbours."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from eskin.errors import ContactError
from eskin.interval import require_plain
from eskin.interval.conversion import enclose

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.contacts.components import Indices
    from eskin.interval import Floats

AXES: Final = "xyz"
"""Names of the coordinates."""


@dataclass(frozen=True, eq=False)
class Skin:
    """Taxels, and which of them are neighbours.

    Positions and areas are exact numbers here: where a tolerance of an area matters, widen the
    pressures by it. All arrays are copied; a caller must not change them.

    Attributes:
        positions: Centres in m, shape ``(n, d)``, d = 1, 2 or 3 coordinates.
        area: What each taxel covers, in m², shape ``(n,)``; one number stands for all taxels.
        starts: Adjacency lists (compressed sparse rows), shape ``(n + 1,)``: the neighbours of
            taxel k are ``neighbours[starts[k]:starts[k + 1]]``.
        neighbours: Taxel numbers; each pair of neighbours is listed at both taxels.

    Raises:
        ContactError: The parts do not fit each other, a position is not finite, an area is not
            positive and finite, or the adjacency is not symmetric.
        IntervalError: Positions or areas are no real numbers.
    """

    positions: Floats
    area: Floats
    starts: Indices
    neighbours: Indices
    _rising: Indices = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positions = _numbers(self.positions, "positions")
        if positions.ndim != 2 or positions.shape[1] not in {1, 2, 3} or positions.shape[0] == 0:
            raise ContactError(
                f"positions have shape {positions.shape}; give a row a taxel, with 1, 2 or 3 "
                "coordinates in m"
            )
        count = positions.shape[0]
        _require_all(np.isfinite(positions), positions, "position", "finite, in m")
        area = _numbers(self.area, "area")
        if area.shape not in {(), (count,)}:
            raise ContactError(
                f"area has shape {area.shape}; give one for each of the {count} taxels, or one "
                "number for all"
            )
        area = np.broadcast_to(area, (count,)).copy()
        _require_all((area > 0.0) & (area < inf), area, "area", "positive and finite, in m²")
        starts = _whole(self.starts, "starts")
        neighbours = _whole(self.neighbours, "neighbours")
        _require_lists(starts, neighbours, count)
        _require_symmetry(starts, neighbours)
        rising = np.ascontiguousarray(np.argsort(positions.T, axis=1, kind="stable"))
        for name, array in (
            ("positions", positions.copy()),
            ("area", area),
            ("starts", starts),
            ("neighbours", neighbours),
            ("_rising", rising),
        ):
            object.__setattr__(self, name, array)

    @classmethod
    def from_edges(cls, positions: ArrayLike, area: ArrayLike, edges: ArrayLike) -> Self:
        """A skin from pairs of neighbours.

        Args:
            positions: Centres in m, shape ``(n, d)``.
            area: What each taxel covers, in m², shape ``(n,)``, or one number for all.
            edges: Pairs of taxel numbers, shape ``(m, 2)``, each pair once, in either order.

        Raises:
            ContactError: As for a skin, or the edges are no pairs of taxel numbers.
        """
        count = len(np.atleast_1d(np.asarray(positions)))
        pairs = np.asarray(edges)
        pairs = _whole(pairs.reshape(0, 2) if pairs.size == 0 else pairs, "edges", axes=2)
        if pairs.shape[1] != 2:
            raise ContactError(f"edges have shape {pairs.shape}; give two taxel numbers a row")
        wrong = (pairs < 0) | (pairs >= count)
        if wrong.any():
            row = int(np.argwhere(wrong)[0, 0])
            raise ContactError(
                f"edge {row} is {tuple(pairs[row].tolist())}; taxels are numbered 0 to {count - 1}"
            )
        both = np.concatenate([pairs, pairs[:, ::-1]])
        both = both[np.lexsort((both[:, 1], both[:, 0]))]
        starts = np.concatenate([[0], np.bincount(both[:, 0], minlength=count).cumsum()])
        return cls(positions, area, starts, both[:, 1])  # type: ignore[arg-type]  # it converts

    @classmethod
    def grid(cls, rows: int, columns: int, *, pitch: float, area: ArrayLike) -> Self:
        """A grid, each taxel beside up to four neighbours.

        Taxel ``row·columns + column`` is at x = column·pitch, y = row·pitch.

        Args:
            rows: Number of rows, at least 1.
            columns: Number of columns, at least 1.
            pitch: Distance of neighbours in m.
            area: What each taxel covers, in m², shape ``(rows·columns,)``, or one number for all.

        Raises:
            ContactError: A number is not positive, or as for a skin.
        """
        require_plain(pitch, "pitch", ContactError)
        if not (rows >= 1 and columns >= 1 and 0.0 < pitch < inf):
            raise ContactError(
                f"a grid of {rows} x {columns} taxels, {pitch} m apart; give at least one row and "
                "column, and a positive, finite pitch"
            )
        row, column = np.divmod(np.arange(rows * columns), columns)
        number = np.arange(rows * columns).reshape(rows, columns)
        beside = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
        below = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
        positions = np.stack([column * pitch, row * pitch], axis=1)
        return cls.from_edges(positions, area, np.concatenate([beside, below]))

    def __len__(self) -> int:
        return len(self.area)

    def __repr__(self) -> str:
        return f"Skin({len(self)} taxels, {len(self.neighbours) // 2} pairs of neighbours)"

    @property
    def dimensions(self) -> int:
        """Number of coordinates."""
        return int(self.positions.shape[1])

    def by_coordinate(self, axis: int) -> Indices:
        """All taxels, by rising coordinate."""
        return np.asarray(self._rising[axis])


def _numbers(value: Any, name: str) -> Floats:
    require_plain(value, name, ContactError)
    return enclose(value, name)[0]


def _whole(value: Any, name: str, axes: int = 1) -> Indices:
    array = np.asarray(value)
    if array.size and array.dtype.kind not in "iu":
        raise ContactError(f"{name} have dtype {array.dtype}; give whole numbers")
    if array.ndim != axes:
        raise ContactError(f"{name} have shape {array.shape}; give an array of {axes} axes")
    return array.astype(np.int64)


def _require_all(good: Any, values: Floats, what: str, needed: str) -> None:
    if not np.all(good):
        where = tuple(np.argwhere(~good)[0].tolist())
        raise ContactError(f"{what} of taxel {where[0]} is {values[where]}; it must be {needed}")


def _require_lists(starts: Indices, neighbours: Indices, count: int) -> None:
    size = neighbours.size
    if starts.shape != (count + 1,) or starts[0] != 0 or starts[-1] != size:
        ends = f"from {starts[0]} to {starts[-1]}" if starts.size else "empty"
        raise ContactError(
            f"starts have shape {starts.shape}, {ends}; {count} taxels with {size} neighbours "
            f"need {count + 1}, from 0 to {size}"
        )
    if np.any(np.diff(starts) < 0):
        taxel = int(np.argmax(np.diff(starts) < 0))
        raise ContactError(f"starts fall after taxel {taxel}; each list starts where one ends")
    wrong = (neighbours < 0) | (neighbours >= count)
    if wrong.any():
        place = int(np.argmax(wrong))
        raise ContactError(
            f"neighbours[{place}] is {neighbours[place]}; taxels are numbered 0 to {count - 1}"
        )


def _require_symmetry(starts: Indices, neighbours: Indices) -> None:
    count = starts.size - 1
    owners = np.repeat(np.arange(count), np.diff(starts))
    if np.any(owners == neighbours):
        taxel = int(owners[np.argmax(owners == neighbours)])
        raise ContactError(f"taxel {taxel} is a neighbour of itself; leave that out")
    codes = np.sort(owners * count + neighbours)
    twice = codes[1:] == codes[:-1]
    if twice.any():
        one, two = divmod(int(codes[:-1][twice][0]), count)
        raise ContactError(f"taxel {one} lists its neighbour {two} twice; list each pair once")
    alone = np.setdiff1d(codes, neighbours * count + owners, assume_unique=True)
    if alone.size:
        one, two = divmod(int(alone[0]), count)
        raise ContactError(
            f"taxel {one} lists {two} as its neighbour, but {two} does not list {one}; list each "
            "pair at both, or use Skin.from_edges"
        )
