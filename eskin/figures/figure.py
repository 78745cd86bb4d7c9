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
class Panel:
    """One pair of axes.

    Attributes:
        ylabel: What is drawn upwards, with its unit in brackets.
        unit: SI unit of the values; the axis takes a prefix.
        lines: Legend to column, drawn as a line.
        bands: Legend to pair of columns (lo, hi), drawn as an area.
        span: How much of the axis to the right is shown, from its start; all if not given.
    """

    ylabel: str
    unit: str
    lines: Mapping[str, str] = field(default_factory=dict)
    bands: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    span: float | None = None


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
