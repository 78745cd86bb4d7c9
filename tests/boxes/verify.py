"""Holds a model's enclosures against its formula at members of hostile boxes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import flint
import numpy as np
from flint import arb

from eskin.errors import IntervalError
from eskin.interval import Interval
from tests.boxes.draw import members
from tests.boxes.models import EVERY, boxes

if TYPE_CHECKING:
    from collections.abc import Mapping

BITS = 900
"""Angles go up to 1e80 turns, and differences cancel 1e80 times."""


@dataclass(slots=True)
class Verdict:
    """What became of a model's boxes.

    Attributes:
        model: Its name.
        boxes: How many were evaluated.
        points: How many members were held against a result.
        refused: How many boxes the model refused with an `IntervalError`.
        violations: Descriptions of members whose value lies outside.
        worst: Greatest distance outside, relative to the result's greatest bound.
    """

    model: str
    boxes: int = 0
    points: int = 0
    refused: int = 0
    violations: list[str] = field(default_factory=list)
    worst: float = 0.0


def verify(model: str, *, count: int, seed: int, each: int = 10) -> Verdict:
    """Try ``count`` boxes of a model, with about ``each`` members of each."""
    before, flint.ctx.prec = flint.ctx.prec, BITS
    try:
        return _verify(model, count, np.random.default_rng(seed), each)
    finally:
        flint.ctx.prec = before


def _verify(model: str, count: int, generator: np.random.Generator, each: int) -> Verdict:
    verdict = Verdict(model)
    drawn = boxes(model, generator, count)
    for i in range(count):
        box = {
            name: Interval(value.inf[i : i + 1], value.sup[i : i + 1])
            for name, value in drawn.items()
        }
        try:
            found = EVERY[model].evaluate(box)
        except IntervalError:
            verdict.refused += 1
            continue
        verdict.boxes += 1
        for point in members(box, 0, generator, each):
            hold(verdict, box, found, point)
    return verdict


def hold(
    verdict: Verdict,
    box: Mapping[str, Interval],
    found: Mapping[str, Interval],
    point: dict[str, Any],
) -> None:
    """Hold one member's value against the enclosures; adds to the verdict."""
    for name, exact in EVERY[verdict.model].truth(point).items():
        if not exact.is_finite():
            continue
        verdict.points += 1
        inf, sup = float(found[name].inf[0]), float(found[name].sup[0])
        if _inside(inf, sup, exact):
            continue
        size = max(abs(inf), abs(sup), 5e-324)
        beyond = max(float(arb(inf) - exact), float(exact - arb(sup))) / size
        verdict.worst = max(verdict.worst, beyond if math.isfinite(beyond) else math.inf)
        given = {key: (float(v.inf[0]), float(v.sup[0])) for key, v in box.items()}
        at = {key: float(value) for key, value in point.items()}
        verdict.violations.append(
            f"{name} [{inf!r}, {sup!r}] lacks {exact.str(20)} at {at} in {given}"
        )


def _inside(inf: float, sup: float, exact: Any) -> bool:
    if math.isnan(inf) or math.isnan(sup):
        return False
    low = inf == -math.inf or not exact < arb(inf)
    high = sup == math.inf or not exact > arb(sup)
    return bool(low and high)
