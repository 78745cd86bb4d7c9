"""Predictions: a quantity of a ³S model over time, with intervals for parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import IntervalError, QueryError
from eskin.interval import Interval
from eskin.moment import SECOND

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from cloud.pyramid.pieces import Integers
    from cloud.query.models import Model
    from eskin.interval import Floats

_FOREVER: Final = 2**63 - 1
_FAR: Final = 2**62
_LONG_S: Final = 1e30
"""More than any time in s that 64 bit hold; models take it."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """A model with its parameters.

    Attributes:
        model: The model.
        parameters: Its parameters, in SI units.
        origin: The model's time 0, UTC ns.
    """

    model: Model
    parameters: Mapping[str, Interval]
    origin: int

    def between(self, first: Integers, last: Integers) -> tuple[Floats, Floats]:
        """An enclosure of the quantity over each stretch of time, its ends included, UTC ns.

        Raises:
            QueryError: The model does not take such parameters.
        """
        size = np.broadcast_shapes(first.shape, last.shape)
        time = Interval(self._seconds(first, -np.inf), self._seconds(last, np.inf))
        try:
            found = self.model.function(time, **self.parameters)
        except IntervalError as error:
            raise QueryError("parameter", str(error)) from error
        values = found if self.model.part is None else getattr(found, self.model.part)
        return np.broadcast_to(values.inf, size), np.broadcast_to(values.sup, size)

    def answers(self, first: Integers, last: Integers, lo: Floats, hi: Floats) -> NDArray[np.int8]:
        """Whether measured intervals are anomalies: certain if disjoint from what is predicted.

        Impossible if inside of it, else possible.

        Args:
            first: The earliest moment at which each was measured, UTC ns.
            last: The latest.
            lo: Lower bounds.
            hi: Upper bounds.
        """
        low, high = self.between(first, last)
        disjoint, inside = (hi < low) | (lo > high), (lo >= low) & (hi <= high)
        return disjoint.astype(np.int8) + ~inside

    def _seconds(self, moments: Integers, side: float) -> Floats:
        """On their side of the exact time; the conversion and the division round once each."""
        near = np.clip(
            moments, max(self.origin - _FAR, -_FOREVER), min(self.origin + _FAR, _FOREVER)
        )
        found = (near - self.origin) / SECOND
        found = np.where(near == moments, found, np.copysign(_LONG_S, moments - near))
        return np.where(found == 0.0, 0.0, np.nextafter(np.nextafter(found, side), side))
