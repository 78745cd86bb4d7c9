"""Bounds are the tightest floats around exact results, or as near as their proof says."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from eskin.interval import Interval
from tests.unit.eskin.kernels.tightness import CASES, UNSOUND, Case

ALWAYS = [case for case in CASES if case.name in {"add", "mul", "sqr", "div", "sqrt", "fma"}]
NEARLY = [case for case in CASES if case not in ALWAYS]
ENDS = (-np.inf, -1e308, -3.0, -1e-170, -5e-324, 0.0, 5e-324, 1e-170, 0.1, 1e308, np.inf)
BOXES = [(a, b) for a, b in product(ENDS, repeat=2) if a <= b and a < np.inf and b > -np.inf]
Number = Fraction | float


def named(case: Case) -> str:
    return f"{case.name}, {case.arguments}"


@pytest.mark.parametrize("case", ALWAYS, ids=named)
def test_arithmetic_is_always_tightest(case: Case) -> None:
    assert not np.any(case.distances(1500, 11))


@pytest.mark.parametrize("case", NEARLY, ids=named)
def test_function_is_nearly_always_tightest_and_else_the_next_float(case: Case) -> None:
    distances = case.distances(1500, 12)
    assert np.min(distances) > UNSOUND
    assert np.max(distances) <= 1
    assert np.mean(distances == 0) > 0.99


def exact_product(x: float, y: float) -> Number:
    """A corner; an infinite end is no member, so zero times infinity is zero."""
    if x == 0.0 or y == 0.0:
        return 0.0
    return x * y if math.isinf(x) or math.isinf(y) else Fraction(x) * Fraction(y)


def exact_sum(x: Number, y: float, infinite: float) -> Number:
    """A corner's sum, or ``infinite`` where a part of it has that end."""
    if infinite in {x, y}:
        return infinite
    return float(x) + y if math.inf in {abs(x), abs(y)} else Fraction(x) + Fraction(y)


def are_tightest(result: Interval, least: list[Number], most: list[Number]) -> bool:
    return all(
        (lo == low or lo <= low < math.nextafter(lo, math.inf))
        and (hi == high or math.nextafter(hi, -math.inf) < high <= hi)
        for lo, low, hi, high in zip(
            result.inf.tolist(), least, result.sup.tolist(), most, strict=True
        )
    )


def of(boxes: list[tuple[float, float]]) -> Interval:
    return Interval(*np.array(boxes).T)


def test_product_of_intervals_is_the_tightest_hull_of_its_corners() -> None:
    pairs = list(product(BOXES, repeat=2))
    corners = [[exact_product(x, y) for x, y in product(a, b)] for a, b in pairs]
    result = of([a for a, _ in pairs]) * of([b for _, b in pairs])
    assert are_tightest(result, [min(each) for each in corners], [max(each) for each in corners])


def test_fma_of_intervals_is_the_tightest_hull_of_its_corners() -> None:
    boxes = np.random.default_rng(4).integers(0, len(BOXES), (4000, 3)).tolist()
    triples = [(BOXES[i], BOXES[j], BOXES[k]) for i, j, k in boxes]
    corners = [[exact_product(x, y) for x, y in product(a, b)] for a, b, _ in triples]
    terms = [c for _, _, c in triples]
    result = of([a for a, _, _ in triples]).fma(of([b for _, b, _ in triples]), of(terms))
    least = [exact_sum(min(p), c[0], -math.inf) for p, c in zip(corners, terms, strict=True)]
    most = [exact_sum(max(p), c[1], math.inf) for p, c in zip(corners, terms, strict=True)]
    assert are_tightest(result, least, most)


@pytest.mark.parametrize("case", CASES, ids=named)
def test_single_numbers_and_arrays_of_any_length_give_the_same_bounds(case: Case) -> None:
    given = case.draw(np.random.default_rng(13), 67)
    whole = case.ours(*map(Interval, given))
    for k in range(67):
        single = case.ours(*(Interval(each[k]) for each in given))
        assert (float(single.inf), float(single.sup)) == (whole.inf[k], whole.sup[k])
    for size in (1, 7, 8, 9, 33):
        few = case.ours(*(Interval(each[:size]) for each in given))
        assert np.array_equal(few.inf, whole.inf[:size])
        assert np.array_equal(few.sup, whole.sup[:size])
