"""How often noise feigns a touch or hides one, against its size and the threshold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import Interval, as_interval, require_plain
from eskin.noise.normal import upper_tail

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = "NDArray[np.float64]"


@dataclass(frozen=True, slots=True)
class ErrorRates:
    """Probabilities of wrong decisions, enclosed.

    Attributes:
        noise: Standard deviations, one a row.
        threshold: Thresholds, one a column.
        false_positive: Probability that an untouched reading reaches the threshold.
        false_negative: Probability that a touched reading does not.
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
) -> ErrorRates:
    """Enclose how often readings with Gaussian noise are judged wrongly.

    With Q the upper tail of the normal distribution, x a reading without noise, T the threshold and
    σ the noise, a reading reaches the threshold with the probability ``Q((T - x)/σ)``.

    Args:
        untouched: Reading without noise and without a touch: a number, or an interval.
        touched: Reading without noise with a touch.
        noise: Standard deviations in the same unit, >= 0, one axis.
        threshold: In the same unit, one axis; a reading on it counts as a touch.

    Returns:
        Probabilities, noise × threshold. They hold that of every member of ``untouched`` and
        ``touched``.

    Raises:
        IntervalError: A value is not allowed.
    """
    sigma = _axis("noise", noise)
    limit = _axis("threshold", threshold)
    if np.any(sigma < 0.0):
        raise IntervalError(f"noise must be >= 0, is {float(sigma.min())!r}")
    at_rest, at_touch = _single("untouched", untouched), _single("touched", touched)
    return ErrorRates(
        sigma,
        limit,
        _tail(Interval(limit) - at_rest, sigma, at_zero=True),
        _tail(at_touch - Interval(limit), sigma, at_zero=False),
    )


def _tail(distance: Interval, sigma: Floats, *, at_zero: bool) -> Interval:
    """Probability that noise exceeds a distance (n,); ``at_zero``: also where both are zero."""
    rows = distance[None, :]
    noisy = upper_tail(rows / Interval(np.where(sigma > 0.0, sigma, 1.0))[:, None])
    most, least = (side <= 0.0 if at_zero else side < 0.0 for side in (rows.inf, rows.sup))
    still = (sigma == 0.0)[:, None]
    return Interval(np.where(still, least, noisy.inf), np.where(still, most, noisy.sup))


def _axis(name: str, value: ArrayLike) -> Floats:
    require_plain(value, name)
    try:
        made = np.atleast_1d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise IntervalError(f"{name}: {error}") from error
    if made.ndim != 1 or not np.all(np.isfinite(made)):
        raise IntervalError(f"{name} must be one axis of finite numbers, is {value!r}")
    return made


def _single(name: str, value: Interval | ArrayLike) -> Interval:
    try:
        bounds = as_interval(value)
    except IntervalError as error:
        raise IntervalError(f"{name}: {error}") from error
    if bounds.size != 1 or not np.all(bounds.is_common_interval):
        raise IntervalError(f"{name} must be one finite number or interval, is {value!r}")
    return bounds.reshape(())
