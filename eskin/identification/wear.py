"""What an enclosed parameter says of wear, and of the time that remains."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from eskin.errors import IdentificationError
from eskin.interval import Interval, Verdicts

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.interval import Floats

    Bounds = Interval | ArrayLike

_FOREVER: Final = float(np.finfo(np.float64).max)


def find_wear(parameter: Interval, sheet: Bounds) -> Verdicts:
    """Whether a parameter has left its data sheet.

    Args:
        parameter: As it is enclosed.
        sheet: As the data sheet states it, broadcast.

    Returns:
        Certain where no value of the parameter is one of the data sheet; impossible where all are.
        Possible also where the parameter is empty: what was assumed of constraints and drift does
        not hold then, and nothing follows.
    """
    stated = Interval.of(sheet)
    known = ~parameter.is_empty
    return Verdicts(parameter.disjoint(stated) & known, parameter.subset(stated) & known)


def remaining_time(parameter: Interval, limits: Bounds, drift: Bounds) -> Interval:
    """Enclose the time from now until a parameter first lies outside of its limits, in s.

    From below it is the time that the fastest drift takes from the end of the enclosure that is
    nearer; 0 where the parameter may lie outside already. From above it is unbounded, unless a
    least drift is stated: then it is the time that this takes from the farthest value within.

    Args:
        parameter: As it is enclosed now; empty where nothing is known.
        limits: Between which the part works, broadcast; positive, an upper one may be unbounded.
        drift: Bounds of the rate ``d ln p/dt`` in 1/s from now on.

    Returns:
        Within ``[0, inf]``; 0 where the parameter certainly lies outside, and from the greatest
        float on where no drift reaches a limit.

    Raises:
        IdentificationError: Limits are not positive, or the drift is not bounded.
    """
    allowed, rate = Interval.of(limits), Interval.of(drift)
    if np.any(allowed.inf < 0.0) or np.any(allowed.sup <= 0.0):
        raise IdentificationError("limits must be positive")
    if not np.all(rate.is_common_interval):
        raise IdentificationError(f"drift must be bounded, not {rate}")
    known = ~parameter.is_empty
    now = Interval.where(known, parameter, Interval(0.0, np.inf))
    inside = now.intersection(allowed)
    some = ~inside.is_empty
    start = Interval.where(some, inside, 1.0).log()
    ends = (
        (allowed.sup, np.isfinite(allowed.sup), rate, 1.0),
        (allowed.inf, allowed.inf > 0.0, -rate, -1.0),
    )
    least = most = np.asarray(np.inf)
    for limit, exists, speed, sign in ends:
        way = sign * (Interval(np.where(exists, limit, 1.0)).log() - start)
        soonest, latest = _passage(way, speed)
        least = np.minimum(least, np.where(exists, soonest, np.inf))
        most = np.minimum(most, np.where(exists, latest, np.inf))
    least = np.where(known & now.subset(allowed), np.minimum(least, _FOREVER), 0.0)
    # What certainly lies outside is gone already; of what is not known nothing is stated.
    return Interval(np.where(some, least, 0.0), np.where(known, np.where(some, most, 0.0), np.inf))


def _passage(way: Interval, speed: Interval) -> tuple[Floats, Floats]:
    """Soonest and latest time for a way that is not negative, at a speed within bounds."""
    runs, must = speed.sup > 0.0, speed.inf > 0.0
    nearest = Interval(np.maximum(way.inf, 0.0))
    soonest = (nearest / Interval(np.where(runs, speed.sup, 1.0))).inf
    slow = Interval(np.where(must, speed.inf, 1.0))
    finite = np.isfinite(way.sup)
    latest = (Interval(np.where(finite, np.maximum(way.sup, 0.0), 0.0)) / slow).sup
    return np.where(runs, soonest, np.inf), np.where(must & finite, latest, np.inf)


def mean_drift(before: Interval, after: Interval, elapsed: Bounds) -> Interval:
    """Mean rate ``d ln p/dt`` between two times at which a parameter is enclosed, in 1/s.

    It needs no model. As the drift of `remaining_time` it serves where the rate is constant.

    Args:
        before: The parameter at the earlier time, not empty.
        after: The parameter at the later one, not empty.
        elapsed: Time between them in s, positive.

    Raises:
        IdentificationError: An enclosure is empty, or the time is not positive.
    """
    time = Interval.of(elapsed)
    if np.any(time.inf <= 0.0):
        raise IdentificationError(f"elapsed time must be positive, not {time}")
    if np.any(before.is_empty) or np.any(after.is_empty):
        raise IdentificationError("an empty enclosure has no drift")
    return (after.log() - before.log()) / time
