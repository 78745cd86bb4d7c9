"""What a model predicts for a channel, and by how much samples lie outside of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from eskin.errors import IntervalError, MonitorError, shown
from eskin.interval import Interval
from eskin.monitor.checks import enclosed
from eskin.monitor.formula import number_text
from eskin.monitor.predicted_quantities import MODELS, UNITS
from eskin.monitor.signal import Signal
from eskin.monitor.units import known_unit, unit_of

if TYPE_CHECKING:
    from fractions import Fraction

    from numpy.typing import NDArray

    from eskin.interval import Floats
    from eskin.monitor.predicted_quantities import Model
    from eskin.monitor.runs import Ticks

_SECOND: Final = 10**9
_HALF: Final = 32
_LOWER: Final = 2**_HALF - 1
_LARGEST: Final = np.finfo(np.float64).max


class PredictionParameter(NamedTuple):
    """Bounds of a parameter of a model, exact.

    Attributes:
        name: Its name.
        lo: The lower bound.
        hi: The upper bound.
        unit: UCUM code; ``None`` for the parameter's own: SI, or the channel's.
    """

    name: str
    lo: Fraction
    hi: Fraction
    unit: str | None = None

    def __str__(self) -> str:
        unit = "" if self.unit is None else f" {self.unit}"
        lo, hi = number_text(self.lo), number_text(self.hi)
        return f"{self.name} = " + (f"{lo}{unit}" if lo == hi else f"[{lo}{unit}, {hi}{unit}]")


@dataclass(frozen=True)
class Prediction:
    """A quantity of a model with parameters that are known within bounds.

    Attributes:
        quantity: Such as ``touch.capacitance``, of `MODELS`.
        parameters: Its parameters.
        origin: The model's time 0, UTC ns.

    Raises:
        MonitorError: There is no such quantity, or it has other parameters.
    """

    quantity: str
    parameters: tuple[PredictionParameter, ...]
    origin: int = 0

    def __post_init__(self) -> None:
        if self.quantity not in MODELS:
            raise MonitorError(
                f"no model predicts {shown(self.quantity)}; take one of {', '.join(MODELS)}",
                value=self.quantity,
            )
        self.model.require_parameters([each.name for each in self.parameters])
        for each in self.parameters:
            if each.lo > each.hi:
                raise MonitorError(
                    f"the bounds of {each.name} are reversed; exchange them", value=each
                )

    def __str__(self) -> str:
        return f"{self.quantity}({', '.join(map(str, self.parameters))})"

    @property
    def model(self) -> Model:
        """The model."""
        return MODELS[self.quantity]

    @property
    def is_constant(self) -> bool:
        """Whether it is the same at all times."""
        return self.model.name == "constant"

    def bounds(self, unit: str) -> dict[str, Interval]:
        """The parameters by name, in SI units; those of a constant in a channel's unit.

        Args:
            unit: UCUM code of the channel.

        Raises:
            MonitorError: The model predicts another unit, or a parameter's unit does not fit.
        """
        if self.model.unit is not None and self.model.unit != unit:
            raise MonitorError(
                f"{self.quantity} predicts {self.model.unit}, not {unit}; take a model of the "
                "channel's unit",
                value=self.model.unit,
            )
        return {each.name: _converted(each, UNITS[each.name] or unit) for each in self.parameters}

    def between(
        self, first: NDArray[np.int64], last: NDArray[np.int64], unit: str
    ) -> tuple[Floats, Floats]:
        """An enclosure of the quantity over each closed range of time.

        Args:
            first: UTC ns.
            last: UTC ns.
            unit: UCUM code of the channel.

        Raises:
            MonitorError: As of `bounds`, or a parameter is out of the model's domain.
        """
        size = np.broadcast_shapes(first.shape, last.shape)
        time = Interval(self._seconds(first, -np.inf), self._seconds(last, np.inf))
        try:
            found = self.model.function(time, **self.bounds(unit))
        except IntervalError as error:
            raise MonitorError(f"{self}: {error}", value=str(self)) from error
        values = found if self.model.part is None else getattr(found, self.model.part)
        return np.broadcast_to(values.inf, size), np.broadcast_to(values.sup, size)

    def _seconds(self, instants: NDArray[np.int64], side: float) -> Floats:
        """Times in s, rounded outward; the sum and the division round once each.

        Differences may need 65 bits, so each half is subtracted separately.
        """
        high = (instants >> _HALF) - (self.origin >> _HALF)
        low = (instants & _LOWER) - (self.origin & _LOWER)
        found = (high * 2.0**_HALF + low) / _SECOND
        return np.where(found == 0.0, 0.0, np.nextafter(np.nextafter(found, side), side))


def _converted(parameter: PredictionParameter, unit: str) -> Interval:
    scale: Fraction | int = 1
    if parameter.unit is not None and parameter.unit != unit:
        own, wanted = known_unit(parameter.unit), unit_of(unit)
        if own is None or own.dimension != wanted.dimension or own.offset or wanted.offset:
            raise MonitorError(
                f"{parameter.name} is in {unit}, not in {parameter.unit}; correct its unit",
                value=parameter.unit,
            )
        scale = own.scale / wanted.scale
    return Interval(enclosed(parameter.lo * scale).inf, enclosed(parameter.hi * scale).sup)


def deviation(signal: Signal, prediction: Prediction, span: Ticks | int = 0) -> Signal:
    """By how much each sample lies outside of what is predicted; negative where it lies inside.

    What is predicted for a sample encloses the quantity at all instants at which it may have been
    taken. The deviation is ``max(p - x, x - q)`` of predictions in [p, q]: certainly positive where
    the sample's interval is disjoint from the prediction, and never positive where it lies inside.

    Args:
        signal: The channel.
        prediction: What is predicted for it.
        span: Of a sample that stands for a run of samples, ns from the first to the last.

    Raises:
        MonitorError: The prediction does not fit the channel.
    """
    lo, hi = prediction.between(signal.earliest, signal.latest + span, signal.unit)
    lowest, highest = lo, hi
    if not prediction.is_constant:
        # Of a run it is not known where in [lo, hi] the predictions for its samples end.
        several = np.broadcast_to(np.asarray(span) > 0, lo.shape)
        lowest, highest = np.where(several, hi, lo), np.where(several, lo, hi)
    with np.errstate(invalid="ignore", over="ignore"):
        least = np.fmax(_less(lo, signal.hi, -np.inf), _less(signal.lo, hi, -np.inf))
        most = np.fmax(_less(lowest, signal.lo, np.inf), _less(signal.hi, highest, np.inf))
    return Signal(
        signal.earliest,
        signal.latest,
        np.where(np.isnan(least), -np.inf, np.minimum(least, _LARGEST)),
        np.where(np.isnan(most), np.inf, np.maximum(most, -_LARGEST)),
        signal.period,
        signal.gap,
        unit=signal.unit,
        coverage=signal.coverage,
        until=signal.until,
    )


def _less(one: Floats, other: Floats, side: float) -> Floats:
    """A difference, rounded to a side; an exact 0 stays."""
    found = one - other
    return np.where((found == 0.0) | ~np.isfinite(found), found, np.nextafter(found, side))
