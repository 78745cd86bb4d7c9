"""How strongly an output answers to each parameter, enclosed over a whole box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.design.dual import Dual
from eskin.design.preconditions import require_bounded, require_pieces
from eskin.errors import DesignError
from eskin.interval import Interval, watch_domains

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

MOST_PIECES = 100_000


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """An output's answer to one parameter.

    Attributes:
        derivative: Encloses ∂output/∂parameter at every point of the box, in the output's unit by
            the parameter's.
        elasticity: Encloses (parameter/output)·∂output/∂parameter: per cent of the output by per
            cent of the parameter.
    """

    derivative: Interval
    elasticity: Interval


def sensitivity(
    formula: Callable[..., object], parameters: Mapping[str, Interval], *, pieces: int = 16
) -> dict[str, Sensitivity]:
    """Enclose how an output answers to each of its parameters.

    Args:
        formula: The output as an expression of its parameters, such as those of
            `eskin.models.formulas`; called by keyword.
        parameters: Each parameter's interval; a thin one is held fixed, but answered to as well.
        pieces: Into how many pieces each interval is divided: more are tighter and take longer.

    Returns:
        One entry a parameter. Each encloses all that is true in the box; the width beyond that
        shrinks in proportion to the pieces.

    Raises:
        DesignError: A parameter is no bounded interval, there are too many pieces in all, or the
            formula cannot be differentiated, or has no value or no slope somewhere in the box.
    """
    for name, value in parameters.items():
        require_bounded(name, value)
    require_pieces(pieces)
    divided = {name: _cuts(value, pieces) for name, value in parameters.items()}
    total = int(np.prod([len(value.inf) for value in divided.values()]))
    if total > MOST_PIECES:
        raise DesignError(f"{total} pieces of a box; at most {MOST_PIECES}: take fewer")
    duals = {}
    for axis, (name, value) in enumerate(divided.items()):
        shape = [1] * len(divided)
        shape[axis] = -1
        boxed = Interval(value.inf.reshape(shape), value.sup.reshape(shape))
        duals[name] = Dual(boxed, {name: Interval(1.0)})
    with watch_domains(1) as watch:
        result = formula(**duals)
    if not isinstance(result, Dual):
        raise DesignError(
            f"the formula gave {type(result).__name__}, so it uses none of {list(duals)}"
        )
    if watch.undefined[0] or np.any(result.value.is_empty):
        raise DesignError(
            "the formula has no value on a part of the box, or no slope; make the box smaller"
        )
    zero = Interval(0.0)
    found = {}
    for name, dual in duals.items():
        partial = result.partials.get(name, zero)
        share = partial * dual.value / result.value
        found[name] = Sensitivity(_whole(partial), _whole(share))
    return found


def _cuts(value: Interval, pieces: int) -> Interval:
    lo, hi = float(value.inf), float(value.sup)
    if lo == hi:
        return Interval([lo])
    cuts = np.clip(np.linspace(lo, hi, pieces + 1), lo, hi)
    return Interval(cuts[:-1], cuts[1:])


def _whole(value: Interval) -> Interval:
    return Interval(float(value.inf.min()), float(value.sup.max()))
