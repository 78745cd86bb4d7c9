"""How far an output spreads under the tolerances of its parts, from its enclosed slopes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from eskin.design.dual import Dual
from eskin.errors import DesignError
from eskin.interval import Interval, watch_domains

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

Boxes: TypeAlias = "Mapping[str, Interval]"
Formula: TypeAlias = "Callable[..., Any]"
Floats: TypeAlias = "NDArray[np.float64]"
Ways: TypeAlias = "dict[str, tuple[Floats, float]]"
"""For each part whether the output rises (1) or falls (-1) with it, box by box; its tolerance."""


def enclose_spread(
    formula: Formula, boxes: Boxes, others: Boxes, tolerance: Mapping[str, float]
) -> tuple[Floats, Floats]:
    """Enclose the width that the output has at the points of each box.

    At a point p the width is the greatest ``f(u) - f(v)`` of all u and v within the tolerances
    around p. Where a slope keeps its sign, u and v lie at the ends of that part's tolerance; what
    they may gain elsewhere is added to the upper bound. The difference of the two ends is bounded
    by its mean-value form (Moore, Kearfott and Cloud 2009, section 6.4) about the ends that its
    slopes point to: exact where they keep their sign, else the error shrinks with the square of a
    box's side.

    Args:
        formula: The output as an expression, such as those of `eskin.models.formulas`.
        boxes: Parameters, shape ``(n, 1)``.
        others: Parameters without tolerance, shape ``(1, m)``.
        tolerance: Relative tolerance of some of the boxes' parameters.

    Returns:
        What the width is at least and at most, shape ``(n, m)``; infinite at a point with a part
        that may leave the output undefined. So the least is infinite for a box without any other
        point, and the most for a box with one such.

    Raises:
        DesignError: The formula cannot be differentiated.
    """
    rows = next(iter(boxes.values())).inf.shape[0]
    with watch_domains(rows) as watch:
        whole = _anywhere(formula, boxes, others, tolerance)
    ways: Ways = {}
    gain = Interval(0.0)
    for name, share in tolerance.items():
        answer = whole.partials.get(name, Interval(0.0)) * boxes[name]
        way = np.where(answer.mid < 0.0, -1.0, 1.0)
        ways[name] = (way, share)
        against = np.maximum(-(answer * Interval(way)).inf, 0.0)
        gain = gain + Interval(0.0, against) * (4.0 * share)
    between = _between_ends(formula, boxes, others, ways)
    least, most = np.maximum(between.inf, 0.0), np.minimum((between + gain).sup, whole.value.wid)
    nowhere = whole.value.is_empty | between.is_empty
    undefined = nowhere | watch.undefined[:, None]
    return np.where(nowhere, np.inf, least), np.where(undefined, np.inf, most)


def _anywhere(
    formula: Formula, boxes: Boxes, others: Boxes, tolerance: Mapping[str, float]
) -> Dual:
    """The output with each part anywhere in its tolerance, and its slopes by the parts."""
    one = Interval(1.0)
    loose = {n: v * Interval.around(1.0, tolerance.get(n, 0.0)) for n, v in boxes.items()}
    parts = {n: Dual(v, {n: one} if n in tolerance else {}) for n, v in loose.items()}
    return _dual(formula(**parts, **{n: Dual(v, {}) for n, v in others.items()}))


def _between_ends(formula: Formula, boxes: Boxes, others: Boxes, ways: Ways) -> Interval:
    """Enclose ``f(upper ends) - f(lower ends)`` at every point of each box that has both."""
    upper, lower = _ends(ways, 1.0), _ends(ways, -1.0)
    rows = next(iter(boxes.values())).inf.shape[0]
    with watch_domains(rows) as watch:
        high, low = (_moved(formula, boxes, others, ends) for ends in (upper, lower))
    # The mean-value form needs slopes from the centre to each point, all the way.
    broken = watch.undefined[:, None]
    inputs = {**boxes, **others}
    zero = Interval(0.0)
    slopes = {n: high.partials.get(n, zero) - low.partials.get(n, zero) for n in inputs}
    form = high.value - low.value
    for side in (1.0, -1.0):
        centre = {n: _centre(v, slopes[n] * side) for n, v in inputs.items()}
        parts, rest = ({n: centre[n] for n in some} for some in (boxes, others))
        mean = _moved(formula, parts, rest, upper).value - _moved(formula, parts, rest, lower).value
        for name, value in inputs.items():
            mean = mean + slopes[name] * (value - centre[name])
        inf, sup = np.where(broken, -np.inf, mean.inf), np.where(broken, np.inf, mean.sup)
        form = form.intersection(Interval._trusted(inf, sup))  # noqa: SLF001 - empty ones, too
    return form


def _centre(value: Interval, slope: Interval) -> Interval:
    """Where the greatest is expected: the end that a slope of one sign points to, or the middle."""
    falling = np.where(slope.sup <= 0.0, value.inf, value.mid)
    return Interval(np.where(slope.inf >= 0.0, value.sup, falling))


def _ends(ways: Ways, side: float) -> dict[str, Interval]:
    return {
        name: Interval(1.0) + Interval(side * way * share) for name, (way, share) in ways.items()
    }


def _moved(formula: Formula, boxes: Boxes, others: Boxes, ends: Boxes) -> Dual:
    """The output with each part at one end of its tolerance, and its slopes by the parameters."""
    one = Interval(1.0)
    parts = {n: Dual(v * ends.get(n, one), {n: ends.get(n, one)}) for n, v in boxes.items()}
    return _dual(formula(**parts, **{n: Dual(v, {n: one}) for n, v in others.items()}))


def _dual(result: object) -> Dual:
    if not isinstance(result, Dual):
        raise DesignError(
            f"the formula gave {type(result).__name__}; it must be an expression of its parameters"
        )
    return result
