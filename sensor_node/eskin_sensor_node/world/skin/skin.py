"""Where the taxels of a skin sit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final, Self, TypeAlias

import numpy as np

from eskin.wire.frames import ClosedLine

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eskin.interval import Floats

Indices: TypeAlias = "NDArray[np.int64]"

NO_NEIGHBOUR: Final = -1
"""Stands in a table of neighbours where a taxel has fewer than others."""
_MICRO: Final = 1e6
_REACH: Final = 1.1
"""Neighbours are at most this many pitches away: the four sides of a grid, not its diagonals."""


@dataclass(frozen=True)
class Skin:
    """Taxels on a surface; its arrays cannot be written.

    Attributes:
        positions: Their centres in m, (n, 3).
        normals: Unit vectors out of the skin, (n, 3).
        pitch: Distance of two neighbours along the surface, in m.
        unrolled: The centres in m on a flat map of the surface, (n, 2).
        outline: Closed line around all cells on this map, in m, (points, 2).
    """

    positions: Floats
    normals: Floats
    pitch: float
    unrolled: Floats
    outline: Floats

    def __post_init__(self) -> None:
        for array in (self.positions, self.normals, self.unrolled, self.outline):
            array.flags.writeable = False

    @classmethod
    def join(cls, parts: Sequence[Skin], outline: Floats) -> Self:
        """Several patches of one pitch as one skin, numbered one after the other."""
        return cls(
            np.concatenate([part.positions for part in parts]),
            np.concatenate([part.normals for part in parts]),
            parts[0].pitch,
            np.concatenate([part.unrolled for part in parts]),
            outline,
        )

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def cell_area(self) -> float:
        """What one taxel covers, in m²."""
        return self.pitch**2

    @property
    def area(self) -> float:
        """What all taxels cover, in m²."""
        return len(self) * self.cell_area

    @cached_property
    def names(self) -> tuple[str, ...]:
        """``t00``, ``t01``, …: as many digits as the last one needs, two at least."""
        digits = max(2, len(str(len(self) - 1)))
        return tuple(f"t{number:0{digits}d}" for number in range(len(self)))

    @cached_property
    def numbers(self) -> dict[str, int]:
        """Name to number."""
        return {name: number for number, name in enumerate(self.names)}

    @cached_property
    def neighbours(self) -> Indices:
        """Numbers of each taxel's neighbours, ascending, padded with `NO_NEIGHBOUR`: (n, most)."""
        cells = np.floor(self.positions / (_REACH * self.pitch)).astype(np.int64)
        members: dict[tuple[int, int, int], list[int]] = {}
        for number, (x, y, z) in enumerate(cells.tolist()):
            members.setdefault((x, y, z), []).append(number)
        found = [self._near(number, members, cells[number].tolist()) for number in range(len(self))]
        table = np.full((len(self), max(1, *map(len, found))), NO_NEIGHBOUR, dtype=np.int64)
        for number, near in enumerate(found):
            table[number, : len(near)] = near
        table.flags.writeable = False
        return table

    def _near(
        self, number: int, members: dict[tuple[int, int, int], list[int]], cell: Sequence[int]
    ) -> list[int]:
        x, y, z = cell
        around = np.array(
            sorted(
                other
                for dx in (-1, 0, 1)
                for dy in (-1, 0, 1)
                for dz in (-1, 0, 1)
                for other in members.get((x + dx, y + dy, z + dz), ())
                if other != number
            ),
            dtype=np.int64,
        )
        far = np.linalg.norm(self.positions[around] - self.positions[number], axis=1)
        near: list[int] = around[far <= _REACH * self.pitch].tolist()
        return near

    @property
    def closed_line(self) -> ClosedLine:
        """The outline as a layout states it."""
        x, y = np.rint(_MICRO * self.outline.T).astype(np.int64).tolist()
        return ClosedLine(tuple(x), tuple(y))

    @property
    def disc_radius(self) -> float:
        """Radius in m of the round plate that has a cell's area."""
        return self.pitch / math.sqrt(math.pi)
