"""The answer of a set inversion: boxes that certainly meet a requirement, possibly, and never."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from eskin.errors import DesignError
from eskin.interval import require_plain

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eskin.interval import Interval

Floats: TypeAlias = "NDArray[np.float64]"


class Region(StrEnum):
    """What a box is."""

    CERTAIN = "certain"
    POSSIBLE = "possible"
    NEVER = "never"


@dataclass(frozen=True, slots=True)
class Paving:
    """Boxes that together fill the space of parameters; they overlap only in their faces.

    Attributes:
        space: The parameters and their intervals.
        lo: Lower corners, shape ``(n, parameters)``, in the order of ``space``.
        hi: Upper corners, the same shape.
        regions: What each box is, shape ``(n,)``: the values of `Region`.
    """

    space: Mapping[str, Interval]
    lo: Floats
    hi: Floats
    regions: NDArray[np.str_]

    def share(self, region: Region) -> float:
        """The region's share of the space's volume.

        Raises:
            ValueError: It is no `Region`.
        """
        wanted = Region(region)
        whole = np.array([float(v.sup) - float(v.inf) for v in self.space.values()])
        volumes = np.prod((self.hi - self.lo) / whole, axis=1)
        return float(np.sum(volumes[self.regions == wanted]))

    def region(self, **point: float) -> Region:
        """What a point of the space is; on the face of two boxes, the surer word counts.

        Raises:
            DesignError: A parameter is missing, unknown, outside of the space, or carries a unit.
        """
        if point.keys() != self.space.keys():
            raise DesignError(f"give {', '.join(self.space)}; not {', '.join(point) or 'nothing'}")
        for name, value in point.items():
            require_plain(value, name, DesignError)
        values = np.array([point[name] for name in self.space])
        inside = np.all((self.lo <= values) & (values <= self.hi), axis=1)
        if not inside.any():
            raise DesignError(f"{point} is outside of the space {dict(self.space)}")
        found = set(self.regions[inside])
        return next(r for r in (Region.CERTAIN, Region.NEVER, Region.POSSIBLE) if r in found)
