"""Predictions: quantities of the ³S models over time, with intervals for parameters."""

from __future__ import annotations

from dataclasses import dataclass
from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import eskin
from eskin.errors import IntervalError, QueryError
from eskin.interval import Interval
from eskin.moment import SECOND

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from cloud.pyramid.pieces import Integers
    from eskin.interval import Floats

_FOREVER: Final = 2**63 - 1
_FAR: Final = 2**62
_LONG_S: Final = 1e30
"""More than any time in s that 64 bit hold; models take it."""


def constant(_time: Interval, *, value: Interval) -> Interval:
    """The same at all times: a band."""
    return value


@dataclass(frozen=True, slots=True)
class Model:
    """A quantity over time.

    Attributes:
        name: Of a function of `eskin.models`, or `constant`.
        part: Which of what it gives; ``None`` where it gives one.
        unit: UCUM code; ``None`` where it is whatever its parameters have.
    """

    name: str
    part: str | None
    unit: str | None

    @property
    def function(self) -> Callable[..., Any]:
        """Time and parameters to intervals."""
        return constant if self.name == "constant" else getattr(eskin.models, self.name)

    def require_parameters(self, given: Mapping[str, Interval]) -> None:
        """Check names.

        Raises:
            QueryError: One is missing, or none of the model's.
        """
        known = {p.name: p for p in signature(self.function).parameters.values()}
        known = {name: p for name, p in known.items() if p.kind is Parameter.KEYWORD_ONLY}
        for name in given:
            if name not in known:
                raise QueryError("parameter", f"{name!r} is none of {', '.join(known)}")
        for name, each in known.items():
            if each.default is Parameter.empty and name not in given:
                raise QueryError("parameter", f"{name} is missing; give parameter={name}:LO:HI")


MODELS: Final = {
    model.name if model.part is None else f"{model.name}.{model.part}": model
    for model in (
        Model("constant", None, None),
        Model("alternating_capacitance", None, "F"),
        Model("alternating_capacitance_paper", None, "F"),
        Model("harmonic_capacitance", None, "F"),
        Model("capacitive_chain", "frequency", "Hz"),
        Model("capacitive_chain", "current", "A"),
        Model("moving_plate", "distance", "m"),
        Model("moving_plate", "capacitance", "F"),
        Model("proximity", "distance", "m"),
        Model("proximity", "inductance", "H"),
        Model("proximity", "frequency", "Hz"),
        Model("resonance", "inductance", "H"),
        Model("resonance", "oscillation", "Hz"),
        Model("resonance", "current", "A"),
        Model("touch", "area", "m2"),
        Model("touch", "capacitance", "F"),
        Model("touch", "energy", "J"),
    )
}
"""All that may be asked for, by name."""


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
