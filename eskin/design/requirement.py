"""What outputs have to be, judged over whole boxes of parameters at once.

A requirement that names parameters in ``for_every`` holds at a design point only if it holds for
each of their values: a current above its limit *for every touch*.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations, product
from typing import TYPE_CHECKING, Final, Protocol, TypeAlias

import numpy as np

from eskin.design.preconditions import require_bounded, require_pieces
from eskin.design.tolerance import enclose_spread
from eskin.errors import DesignError
from eskin.interval import Interval, require_plain, watch_domains

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

Boxes: TypeAlias = "Mapping[str, Interval]"
"""Parameters by name, each an `Interval` of shape ``(n,)``: n boxes."""
Truths: TypeAlias = "NDArray[np.bool_]"
Output: TypeAlias = "Callable[..., Interval]"
"""A model: takes parameters by keyword, gives an `Interval` of their broadcast shape.

A point at which it has no value meets no requirement. A box is certain only if it is defined
everywhere in it: IEEE 1788's decoration ``def``.
"""

MOST_TOLERANCES: Final = 6


@dataclass(frozen=True, slots=True)
class Judgement:
    """What is known of each box.

    Attributes:
        certain: Every point of the box meets the requirement.
        impossible: No point of the box meets it.
    """

    certain: Truths
    impossible: Truths


class Requirement(Protocol):
    """Judges boxes; a box of which neither is known is to be divided."""

    def judge(self, boxes: Boxes) -> Judgement:
        """Judge n boxes."""


@dataclass(frozen=True, slots=True)
class Within:
    """An output stays inside a band.

    Attributes:
        output: The model.
        lo: Least value allowed; ``-inf`` for none.
        hi: Greatest value allowed; ``inf`` for none.
        for_every: Parameters that may take any value of their interval.
        pieces: Into how many pieces each of these is divided.
    """

    output: Output
    lo: float = -np.inf
    hi: float = np.inf
    for_every: Mapping[str, Interval] = field(default_factory=dict)
    pieces: int = 8

    def __post_init__(self) -> None:
        require_plain([self.lo, self.hi], "the band", DesignError)
        if not self.lo <= self.hi:
            raise DesignError(f"the band [{self.lo}, {self.hi}] is empty; give lo <= hi")
        _require_divisible(self.for_every, self.pieces)

    def judge(self, boxes: Boxes) -> Judgement:
        """Judge n boxes."""
        _require_other_names(boxes, self.for_every)
        whole, defined = _call(self.output, boxes, _pieces(self.for_every, self.pieces))
        thin, _ = _call(self.output, boxes, _samples(self.for_every, self.pieces))
        certain = (whole.inf >= self.lo) & (whole.sup <= self.hi)
        impossible = (thin.sup < self.lo) | (thin.inf > self.hi) | thin.is_empty
        return Judgement(defined & np.all(certain, axis=1), np.any(impossible, axis=1))


@dataclass(frozen=True, slots=True)
class Narrower:
    """An output's interval, under the tolerances of the parts, is narrower than a limit.

    Attributes:
        output: The model.
        width: Greatest width allowed, in the output's unit.
        tolerance: Relative tolerance of each part that has one: 0.01 is ±1 %.
        for_every: Parameters that may take any value of their interval.
        pieces: Into how many pieces each of these is divided: more pieces leave less undecided.
        expression: The model is an expression that `eskin.design.Dual` runs through, such as those
            of `eskin.models.formulas`. Its slopes then separate a box's extent from the width, and
            few boxes and pieces are enough; for any other model that extent counts as width.
    """

    output: Output
    width: float
    tolerance: Mapping[str, float]
    for_every: Mapping[str, Interval] = field(default_factory=dict)
    pieces: int = 64
    expression: bool = False

    def __post_init__(self) -> None:
        _require_divisible(self.for_every, self.pieces)
        require_plain(self.width, "width", DesignError)
        if not self.width >= 0.0:
            raise DesignError(f"width: {self.width} is no greatest width; give a number >= 0")
        if not 1 <= len(self.tolerance) <= MOST_TOLERANCES:
            raise DesignError(f"tolerances: give 1 to {MOST_TOLERANCES}, not {len(self.tolerance)}")
        for name, share in self.tolerance.items():
            require_plain(share, f"tolerance of {name}", DesignError)
            if not 0.0 <= share < 1.0:
                raise DesignError(f"tolerance of {name}: {share} is outside of [0, 1)")

    def judge(self, boxes: Boxes) -> Judgement:
        """Judge n boxes: by slopes, or by all that tolerances allow and by the tolerances' ends."""
        _require_other_names(boxes, self.for_every)
        if unknown := self.tolerance.keys() - boxes.keys():
            raise DesignError(
                f"tolerance of {', '.join(sorted(unknown))}: the space has {', '.join(boxes)}"
            )
        return self._by_slopes(boxes) if self.expression else self._by_values(boxes)

    def _by_slopes(self, boxes: Boxes) -> Judgement:
        columns = _columns(boxes)
        whole, thin = _pieces(self.for_every, self.pieces), _samples(self.for_every, self.pieces)
        _, most = enclose_spread(self.output, columns, whole, self.tolerance)
        least, _ = enclose_spread(self.output, columns, thin, self.tolerance)
        return Judgement(np.all(most <= self.width, axis=1), np.any(least > self.width, axis=1))

    def _by_values(self, boxes: Boxes) -> Judgement:
        spread = {n: v * _factor(self.tolerance.get(n, 0.0)) for n, v in boxes.items()}
        whole, defined = _call(self.output, spread, _pieces(self.for_every, self.pieces))
        certain: Truths = defined & np.all(whole.wid <= self.width, axis=1)
        samples = _samples(self.for_every, self.pieces)
        ends = [_call(self.output, moved, samples)[0] for moved in self._ends(boxes)]
        impossible = np.zeros(certain.shape, dtype=bool)
        for end in ends:
            impossible |= np.any(end.is_empty, axis=1)
        for one, other in combinations(ends, 2):
            impossible |= np.any((one - other).mig > self.width, axis=1)
        return Judgement(certain, impossible)

    def _ends(self, boxes: Boxes) -> list[dict[str, Interval]]:
        names = [name for name in boxes if self.tolerance.get(name, 0.0) > 0.0]
        moved = []
        for signs in product((-1.0, 1.0), repeat=len(names)):
            shares = {n: s * self.tolerance[n] for n, s in zip(names, signs, strict=True)}
            moved.append({n: v * (Interval(1.0) + shares.get(n, 0.0)) for n, v in boxes.items()})
        return moved


@dataclass(frozen=True, slots=True)
class All:
    """Several requirements at once.

    Attributes:
        parts: The requirements.
    """

    parts: tuple[Requirement, ...]

    def __post_init__(self) -> None:
        if not self.parts:
            raise DesignError("there is no requirement; give at least one")

    def judge(self, boxes: Boxes) -> Judgement:
        """Judge n boxes."""
        judged = [part.judge(boxes) for part in self.parts]
        return Judgement(
            np.logical_and.reduce([each.certain for each in judged]),
            np.logical_or.reduce([each.impossible for each in judged]),
        )


def _factor(share: float) -> Interval:
    return Interval.around(1.0, share)


def _call(output: Output, boxes: Boxes, others: Mapping[str, Interval]) -> tuple[Interval, Truths]:
    """Evaluate on n boxes times m values of the others: shape ``(n, m)``.

    Returns:
        The enclosure, and for each box whether the output is certainly defined all over it.
    """
    n = next(iter(boxes.values())).inf.shape[0]
    with watch_domains(n) as watch:
        result = output(**_columns(boxes), **others)
    if not isinstance(result, Interval):
        raise DesignError(f"the output gave {type(result).__name__}; it must give an Interval")
    if result.inf.ndim != 2 or result.inf.shape[0] != n:
        raise DesignError(
            f"the output has shape {result.inf.shape} for parameters of shape ({n}, 1) and (1, m); "
            "it must follow numpy's broadcasting"
        )
    return result, ~(watch.undefined | result.is_empty.any(axis=1))


def _require_divisible(for_every: Mapping[str, Interval], pieces: int) -> None:
    for name, value in for_every.items():
        require_bounded(name, value)
    require_pieces(pieces)


def _require_other_names(boxes: Boxes, for_every: Mapping[str, Interval]) -> None:
    if both := boxes.keys() & for_every.keys():
        raise DesignError(
            f"{', '.join(sorted(both))}: in the space and in for_every; a parameter is either "
            "chosen or may take any value"
        )


def _columns(boxes: Boxes) -> dict[str, Interval]:
    return {name: Interval(v.inf[:, None], v.sup[:, None]) for name, v in boxes.items()}


def _pieces(for_every: Mapping[str, Interval], pieces: int) -> dict[str, Interval]:
    """All combinations of pieces, shape ``(1, pieces ** len(for_every))``."""
    cuts = [_cuts(value, pieces) for value in for_every.values()]
    lo = np.meshgrid(*(cut[:-1] for cut in cuts), indexing="ij")
    hi = np.meshgrid(*(cut[1:] for cut in cuts), indexing="ij")
    return {
        name: Interval(one.reshape(1, -1), other.reshape(1, -1))
        for name, one, other in zip(for_every, lo, hi, strict=True)
    }


def _samples(for_every: Mapping[str, Interval], pieces: int) -> dict[str, Interval]:
    """All combinations of single values, the ends among them."""
    grids = np.meshgrid(*(_cuts(value, pieces) for value in for_every.values()), indexing="ij")
    return {
        name: Interval(grid.reshape(1, -1)) for name, grid in zip(for_every, grids, strict=True)
    }


def _cuts(value: Interval, pieces: int) -> NDArray[np.float64]:
    lo, hi = float(value.inf), float(value.sup)
    cuts = np.linspace(lo, hi, pieces + 1)
    return np.clip(cuts, lo, hi)
