"""Predict a quantity of a ³S model over time, with interval parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import IntervalError, QueryError
from eskin.interval import Interval
from eskin.wire.timestamp import SECOND

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin_cloud.query.models import Model
    from eskin_cloud.rollup.aggregates import Integers

_HALF: Final = 32
_LOWER: Final = 2**_HALF - 1


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
        """An enclosure of the quantity over each closed range of time, UTC ns.

        Raises:
            QueryError: A parameter is out of the model's domain.
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
        """Whether measured intervals are anomalies.

        Certain if disjoint from the prediction, impossible if inside of it, else possible.

        Args:
            first: The earliest time of each measurement, UTC ns.
            last: The latest.
            lo: Lower bounds.
            hi: Upper bounds.
        """
        low, high = self.between(first, last)
        disjoint, inside = (hi < low) | (lo > high), (lo >= low) & (hi <= high)
        return disjoint.astype(np.int8) + ~inside

    def _seconds(self, moments: Integers, side: float) -> Floats:
        """Times in s, rounded outward; the sum and the division round once each.

        Differences may need 65 bits, so each half is subtracted separately.
        """
        high = (moments >> _HALF) - (self.origin >> _HALF)
        low = (moments & _LOWER) - (self.origin & _LOWER)
        found = (high * 2.0**_HALF + low) / SECOND
        return np.where(found == 0.0, 0.0, np.nextafter(np.nextafter(found, side), side))
