"""How often noise feigns a touch or hides one, against its size and the threshold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Interval, as_interval

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = "NDArray[np.float64]"


@dataclass(frozen=True, slots=True)
class ErrorRates:
    """Shares of wrong decisions; intervals where the untouched or the touched value is one.

    Attributes:
        noise: Standard deviations, one a row.
        threshold: Thresholds, one a column.
        false_positive: Share of untouched readings that reach the threshold.
        false_negative: Share of touched readings that do not.
    """

    noise: Floats
    threshold: Floats
    false_positive: Interval
    false_negative: Interval


def error_rates(
    *,
    untouched: Interval | ArrayLike,
    touched: Interval | ArrayLike,
    noise: ArrayLike,
    threshold: ArrayLike,
    draws: int,
    generator: Generator,
) -> ErrorRates:
    """Simulate readings with and without a touch, and count the wrong decisions.

    The same draws serve every point of the curves, so that these are smooth and monotone.

    Args:
        untouched: Reading without noise and without a touch: a number, or an interval.
        touched: Reading without noise with a touch.
        noise: Standard deviations in the same unit, >= 0, one axis.
        threshold: In the same unit, one axis; a reading on it counts as a touch.
        draws: How many readings of each kind, >= 1.
        generator: Draws the noise; the same seed gives the same rates.

    Returns:
        Rates, noise × threshold.

    Raises:
        IntervalError: A value is not allowed.
    """
    sigma = _axis("noise", noise)
    limit = _axis("threshold", threshold)
    if np.any(sigma < 0.0):
        raise IntervalError(f"noise must be >= 0, is {float(sigma.min())!r}")
    if draws < 1:
        raise IntervalError(f"draws must be >= 1, is {draws!r}")
    at_rest, at_touch = _single("untouched", untouched), _single("touched", touched)
    rest = np.sort(generator.standard_normal(draws))
    hand = np.sort(generator.standard_normal(draws))
    return ErrorRates(
        sigma,
        limit,
        Interval(*(1.0 - _share_below(rest, x, sigma, limit) for x in at_rest)),
        Interval(*(_share_below(hand, x, sigma, limit) for x in reversed(at_touch))),
    )


def _share_below(noise: Floats, value: float, sigma: Floats, limit: Floats) -> Floats:
    """Share of ``value + sigma·noise`` that stays below each limit."""
    rows = []
    for each in sigma:
        if each == 0.0:
            rows.append(np.where(value < limit, 1.0, 0.0))
        else:
            rows.append(np.searchsorted(noise, (limit - value) / each, side="left") / noise.size)
    return np.array(rows).reshape(sigma.size, limit.size)


def _axis(name: str, value: ArrayLike) -> Floats:
    try:
        made = np.atleast_1d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise IntervalError(f"{name}: {error}") from error
    if made.ndim != 1 or not np.all(np.isfinite(made)):
        raise IntervalError(f"{name} must be one axis of finite numbers, is {value!r}")
    return made


def _single(name: str, value: Interval | ArrayLike) -> tuple[float, float]:
    try:
        bounds = as_interval(value)
    except IntervalError as error:
        raise IntervalError(f"{name}: {error}") from error
    inf, sup = np.asarray(bounds.inf), np.asarray(bounds.sup)
    if inf.size != 1 or not (np.isfinite(inf).all() and np.isfinite(sup).all()):
        raise IntervalError(f"{name} must be one finite number or interval, is {value!r}")
    return float(inf.item()), float(sup.item())
