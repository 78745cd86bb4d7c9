"""A paving as a picture: two of its parameters, the others cut at a value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.design.paving import Region
from eskin.errors import DesignError
from eskin.interval import require_plain

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes

    from eskin.design.paving import Paving

LOOKS: Final = {
    Region.CERTAIN: "#1b7f5c",
    Region.POSSIBLE: "#f2c14e",
    Region.NEVER: "#f4f4f4",
}
"""Colour of each region, from dark to light: distinct without colour, too."""


def draw_paving(
    paving: Paving, axes: Axes, *, x: str, y: str, at: Mapping[str, float] | None = None
) -> None:
    """Draw the boxes of a plane through the space.

    Args:
        paving: What to draw.
        axes: Where (matplotlib).
        x: The parameter to the right.
        y: The parameter upwards.
        at: A value for each other parameter.

    Raises:
        DesignError: A parameter is unknown, or one of the others has no value.
    """
    from matplotlib.collections import PolyCollection  # noqa: PLC0415 - drawing is an extra
    from matplotlib.patches import Patch  # noqa: PLC0415 - likewise

    names = list(paving.space)
    others = {name: value for name, value in (at or {}).items() if name not in {x, y}}
    if x == y or {x, y, *others} != set(names):
        raise DesignError(f"the space has {names}: give x and y, and a value in at for the others")
    cut = np.ones(len(paving.lo), dtype=bool)
    for name, value in others.items():
        require_plain(value, name, DesignError)
        k = names.index(name)
        cut &= (paving.lo[:, k] <= value) & (value <= paving.hi[:, k])
    i, j = names.index(x), names.index(y)
    for region, colour in LOOKS.items():
        chosen = cut & (paving.regions == region)
        lo, hi = paving.lo[chosen], paving.hi[chosen]
        corners = np.stack(
            [
                np.stack([lo[:, i], hi[:, i], hi[:, i], lo[:, i]], axis=1),
                np.stack([lo[:, j], lo[:, j], hi[:, j], hi[:, j]], axis=1),
            ],
            axis=2,
        )
        axes.add_collection(
            PolyCollection(list(corners), facecolors=colour, edgecolors=colour, linewidths=0.1)
        )
    axes.set_xlim(float(paving.space[x].inf), float(paving.space[x].sup))
    axes.set_ylim(float(paving.space[y].inf), float(paving.space[y].sup))
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    handles = [Patch(facecolor=c, edgecolor="#888888", label=str(r)) for r, c in LOOKS.items()]
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
