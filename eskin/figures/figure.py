"""What a figure is: columns of numbers, and panels that draw them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eskin.interval import Interval

Floats: TypeAlias = "NDArray[np.float64]"


@dataclass(frozen=True, slots=True)
class Look:
    """How one line is drawn, where it must differ from another one.

    Attributes:
        colour: Place in the list of colours; the line's own place if not given.
        style: As matplotlib has it; that of the line's place if not given.
        width: In points.
        alpha: 1 is opaque.
    """

    colour: int | None = None
    style: str | tuple[float, tuple[float, ...]] | None = None
    width: float = 1.3
    alpha: float = 1.0


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes.

    Attributes:
        ylabel: What is drawn upwards, with its unit in brackets.
        unit: SI unit of the values; the axis takes a prefix.
        lines: Legend to column, drawn as a line; later ones lie above.
        bands: Legend to pair of columns (lo, hi), drawn as an area.
        looks: Legend to look, of lines that do not have the usual one.
        window: Ends of what is shown of the axis to the right; all if not given.
        inset: Likewise, of what is shown again in a window of its own.
        logarithmic: Ends of a logarithmic axis upwards; it is linear if not given.
    """

    ylabel: str
    unit: str
    lines: Mapping[str, str] = field(default_factory=dict)
    bands: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    looks: Mapping[str, Look] = field(default_factory=dict)
    window: tuple[float, float] | None = None
    inset: tuple[float, float] | None = None
    logarithmic: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of the paper, drawn anew.

    Attributes:
        name: Such as ``fig4a``.
        title: What it shows.
        caption: What is the paper's, what is corrected, and what we had to choose.
        columns: Header to numbers, all of one length; the first is drawn to the right.
        xlabel: What is drawn to the right.
        panels: From top to bottom.
    """

    name: str
    title: str
    caption: str
    columns: Mapping[str, Floats]
    xlabel: str
    panels: tuple[Panel, ...]

    @property
    def x_unit(self) -> str:
        """Unit of the axis to the right."""
        return next(iter(self.columns)).rpartition("_")[2]


def band(quantity: str, unit: str, values: Interval) -> dict[str, Floats]:
    """The two columns of an interval: ``quantity_lo_unit`` and ``quantity_hi_unit``."""
    return {f"{quantity}_lo_{unit}": values.inf, f"{quantity}_hi_{unit}": values.sup}


def middle(values: Interval) -> Floats:
    """The one number behind intervals of thin parameters: they differ by rounding only."""
    return np.asarray(values.mid)
