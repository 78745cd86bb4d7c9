"""What IEEE 1788-2015 says of special cases, set-based flavour."""
# ruff: noqa: PLW0108 - all cases read alike, as functions

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest

from eskin.interval import Interval

if TYPE_CHECKING:
    from collections.abc import Callable

INF = math.inf
EMPTY = Interval.empty()
ENTIRE = Interval.entire()
ZERO = Interval(0.0)
TINY = 5e-324
MOST = float(np.finfo(float).max)


def same(result: Interval, expected: Interval) -> bool:
    return bool(result.equal(expected))


@pytest.mark.parametrize(
    ("of", "expected"),
    [
        (lambda: EMPTY + 1.0, EMPTY),
        (lambda: 1.0 - EMPTY, EMPTY),
        (lambda: EMPTY * ENTIRE, EMPTY),
        (lambda: ENTIRE / EMPTY, EMPTY),
        (lambda: Interval(1.0, INF) + Interval(-INF, 2.0), ENTIRE),
        (lambda: Interval(1.0, INF) - Interval(1.0, INF), ENTIRE),
        (lambda: ZERO * ENTIRE, ZERO),
        (lambda: Interval(0.0, 1.0) * Interval(2.0, INF), Interval(0.0, INF)),
        (lambda: Interval(-2.0, 3.0) * Interval(-INF, 0.0), ENTIRE),
        (lambda: Interval(1.0, 2.0) / ZERO, EMPTY),
        (lambda: ZERO / Interval(-1.0, 1.0), ZERO),
        (lambda: Interval(1.0, 2.0) / Interval(-1.0, 1.0), ENTIRE),
        (lambda: Interval(1.0, 2.0) / Interval(0.0, 4.0), Interval(0.25, INF)),
        (lambda: Interval(1.0, 2.0) / Interval(-4.0, 0.0), Interval(-INF, -0.25)),
        (lambda: Interval(-2.0, -1.0) / Interval(0.0, 4.0), Interval(-INF, -0.25)),
        (lambda: Interval(-1.0, 2.0) / Interval(0.0, 4.0), ENTIRE),
        (lambda: Interval(0.0, 2.0) / Interval(0.0, 4.0), Interval(0.0, INF)),
        (lambda: Interval(1.0, INF) / Interval(1.0, INF), Interval(0.0, INF)),
        (lambda: ENTIRE / Interval(2.0, 3.0), ENTIRE),
        (lambda: Interval(-2.0, 4.0).recip(), ENTIRE),
        (lambda: Interval(0.0, INF).recip(), Interval(0.0, INF)),
        (lambda: Interval(-INF, -2.0).recip(), Interval(-0.5, 0.0)),
        (lambda: Interval(-3.0, 2.0).sqr(), Interval(0.0, 9.0)),
        (lambda: ENTIRE.sqr(), Interval(0.0, INF)),
        (lambda: Interval(-4.0, 9.0).sqrt(), Interval(0.0, 3.0)),
        (lambda: Interval(-4.0, -1.0).sqrt(), EMPTY),
        (lambda: Interval(4.0, INF).sqrt(), Interval(2.0, INF)),
        (lambda: abs(Interval(-3.0, 2.0)), Interval(0.0, 3.0)),
        (lambda: abs(Interval(-3.0, -2.0)), Interval(2.0, 3.0)),
        (lambda: abs(EMPTY), EMPTY),
        (lambda: -EMPTY, EMPTY),
        (lambda: Interval(2.0).pown(0), Interval(1.0)),
        (lambda: EMPTY.pown(0), EMPTY),
        (lambda: ZERO.pown(-1), EMPTY),
        (lambda: ZERO.pown(-2), EMPTY),
        (lambda: Interval(-2.0, 3.0).pown(3), Interval(-8.0, 27.0)),
        (lambda: Interval(-2.0, 3.0).pown(4), Interval(0.0, 81.0)),
        (lambda: Interval(-2.0, 3.0).pown(-1), ENTIRE),
        (lambda: Interval(0.0, 2.0).pown(-1), Interval(0.5, INF)),
        (lambda: Interval(-2.0, 0.0).pown(-1), Interval(-INF, -0.5)),
        (lambda: Interval(0.0, 1.0).pown(-2), Interval(1.0, INF)),
        (lambda: Interval(-1.0, 1.0).pow(0.0), Interval(1.0)),
        (lambda: Interval(-2.0, -1.0).pow(2.0), EMPTY),
        (lambda: ZERO.pow(Interval(-1.0, 1.0)), ZERO),
        (lambda: ZERO.pow(-1.0), EMPTY),
        (lambda: ZERO.pow(0.0), EMPTY),
        (lambda: Interval(0.0, 1.0).pow(Interval(0.0, 1.0)), Interval(0.0, 1.0)),
        (lambda: Interval(0.0, 1.0).pow(Interval(-1.0, 0.0)), Interval(1.0, INF)),
        (lambda: Interval(1.0).pow(ENTIRE), Interval(1.0)),
        (lambda: ENTIRE.exp(), Interval(0.0, INF)),
        (lambda: ZERO.exp(), Interval(1.0)),
        (lambda: Interval(1000.0).exp().intersection(Interval(MOST, INF)), Interval(MOST, INF)),
        (lambda: Interval(0.0, 1.0).log(), Interval(-INF, 0.0)),
        (lambda: Interval(-1.0, 0.0).log(), EMPTY),
        (lambda: ENTIRE.log(), ENTIRE),
        (lambda: ENTIRE.sin(), Interval(-1.0, 1.0)),
        (lambda: ZERO.sin(), ZERO),
        (lambda: ZERO.cos(), Interval(1.0)),
        (lambda: Interval(1.0, 2.0).tan(), ENTIRE),
        (lambda: ZERO.atan(), ZERO),
        (lambda: ZERO.atan2(ZERO), EMPTY),
        (lambda: ZERO.atan2(Interval(1.0, 2.0)), ZERO),
        (lambda: EMPTY.atan2(1.0), EMPTY),
        (lambda: EMPTY.sin(), EMPTY),
        (lambda: EMPTY.exp(), EMPTY),
        (lambda: EMPTY.min(1.0), EMPTY),
        (lambda: Interval(1.0, 4.0).min(Interval(2.0, 3.0)), Interval(1.0, 3.0)),
        (lambda: Interval(1.0, 4.0).max(Interval(2.0, 3.0)), Interval(2.0, 4.0)),
        (lambda: Interval(1.0, 2.0).convex_hull(EMPTY), Interval(1.0, 2.0)),
        (lambda: Interval(1.0, 2.0).convex_hull(Interval(4.0, 5.0)), Interval(1.0, 5.0)),
        (lambda: Interval(1.0, 2.0).intersection(Interval(3.0, 4.0)), EMPTY),
        (lambda: Interval(1.0, 3.0).intersection(Interval(2.0, 4.0)), Interval(2.0, 3.0)),
        (lambda: Interval(0.0, 4.0) * 1.0, Interval(0.0, 4.0)),
        (lambda: Interval(1.5, 3.0).acos(), EMPTY),
        (lambda: Interval(1.0).acos(), ZERO),
        (lambda: Interval(-INF, 0.5).acosh(), EMPTY),
        (lambda: Interval(0.5, 1.0).acosh(), ZERO),
        (lambda: Interval(-3.0, -1.0).atanh(), EMPTY),
        (lambda: Interval(-1.0, 1.0).atanh(), ENTIRE),
        (lambda: ENTIRE.tanh(), Interval(-1.0, 1.0)),
        (lambda: ENTIRE.cosh(), Interval(1.0, INF)),
        (lambda: ENTIRE.sinh(), ENTIRE),
        (lambda: ENTIRE.asinh(), ENTIRE),
        (lambda: ENTIRE.expm1(), Interval(-1.0, INF)),
        (lambda: Interval(-5.0, -1.0).log1p(), EMPTY),
        (lambda: Interval(-1.0, 0.0).log1p(), Interval(-INF, 0.0)),
        (lambda: Interval(-1074.0, 10.0).exp2(), Interval(TINY, 1024.0)),
        (lambda: Interval(0.0, 22.0).exp10(), Interval(1.0, 1e22)),
        (lambda: Interval(TINY, 1024.0).log2(), Interval(-1074.0, 10.0)),
        (lambda: Interval(1.0, 1e22).log10(), Interval(0.0, 22.0)),
        (lambda: Interval(-27.0, 64.0).rootn(3), Interval(-3.0, 4.0)),
        (lambda: Interval(-16.0, 81.0).rootn(4), Interval(0.0, 3.0)),
        (lambda: Interval(-16.0, -1.0).rootn(4), EMPTY),
        (lambda: Interval(0.0, 32.0).rootn(-5), Interval(0.5, INF)),
        (lambda: Interval(-32.0, 1.0).rootn(-5), ENTIRE),
        (lambda: ZERO.rootn(-5), EMPTY),
        (lambda: Interval(-3.0, 1.0).hypot(Interval(-4.0, 4.0)), Interval(0.0, 5.0)),
        (lambda: Interval(1e-200).hypot(ZERO), Interval(1e-200)),
        (lambda: Interval(-1.5, 2.0).sign(), Interval(-1.0, 1.0)),
        (lambda: EMPTY.sign(), EMPTY),
        (lambda: Interval(-1.5, 2.5).round_ties_to_even(), Interval(-2.0, 2.0)),
        (lambda: Interval(-1.5, 2.5).round_ties_to_away(), Interval(-2.0, 3.0)),
        (lambda: Interval(0.49999999999999994).round_ties_to_away(), ZERO),
        (lambda: Interval(-1.5, 2.5).trunc(), Interval(-1.0, 2.0)),
        (lambda: Interval(1.0, 4.0).cancel_minus(Interval(1.0, 2.0)), Interval(0.0, 2.0)),
        (lambda: Interval(1.0, 2.0).cancel_minus(Interval(1.0, 4.0)), ENTIRE),
        (lambda: Interval(1.0, 4.0).cancel_plus(Interval(1.0, 2.0)), Interval(3.0, 5.0)),
        (lambda: EMPTY.cancel_minus(Interval(1.0, 2.0)), EMPTY),
        (lambda: EMPTY.cancel_minus(ENTIRE), ENTIRE),
        (lambda: Interval(1.0, 2.0).cancel_minus(EMPTY), ENTIRE),
        (
            lambda: Interval(-TINY, MOST).cancel_minus(Interval(-MOST, TINY)),
            Interval(math.nextafter(MOST, 0.0), MOST),
        ),
        (lambda: Interval(1.0, 2.0 + 2**-51).cancel_minus(Interval(1.0, 2.0 + 2**-50)), ENTIRE),
        (lambda: Interval(TINY) * 0.5, Interval(0.0, TINY)),
        (lambda: Interval(MOST) * 2.0, Interval(MOST, INF)),
    ],
)
def test_special_case_is_as_in_the_standard(of: Callable[[], Interval], expected: Interval) -> None:
    # A function, since each worker collects all cases: on a fresh machine each would compile.
    result = of()
    assert same(result, expected), result


def test_arc_sine_leaves_out_what_it_does_not_have() -> None:
    assert same(Interval(0.5, 3.0).asin(), Interval(0.5, 1.0).asin())


@pytest.mark.parametrize(
    ("y", "x", "lo", "hi"),
    [
        ((1.0, 2.0), (1.0, 2.0), math.atan2(1, 2), math.atan2(2, 1)),
        ((1.0, 2.0), (-2.0, 2.0), math.atan2(1, 2), math.atan2(1, -2)),
        ((1.0, 2.0), (-2.0, -1.0), math.atan2(2, -1), math.atan2(1, -2)),
        ((0.0, 1.0), (-1.0, 0.0), math.pi / 2, math.pi),
        ((0.0, 1.0), (0.0, 1.0), 0.0, math.pi / 2),
        ((0.0, 1.0), (-1.0, 1.0), 0.0, math.pi),
        ((-1.0, 0.0), (0.0, 1.0), -math.pi / 2, 0.0),
        ((-1.0, 0.0), (-1.0, 1.0), -math.pi, math.pi),
        ((-1.0, 1.0), (-1.0, 1.0), -math.pi, math.pi),
        ((-1.0, 1.0), (0.0, 1.0), -math.pi / 2, math.pi / 2),
        ((-2.0, -1.0), (-2.0, 2.0), math.atan2(-1, -2), math.atan2(-1, 2)),
        ((0.0, 0.0), (-1.0, 0.0), math.pi, math.pi),
        ((0.0, 0.0), (-1.0, 1.0), 0.0, math.pi),
    ],
)
def test_angle_of_a_box_is_tight(
    y: tuple[float, float], x: tuple[float, float], lo: float, hi: float
) -> None:
    result = Interval(*y).atan2(Interval(*x))
    assert result.inf <= lo <= lo + 1e-300 <= float(result.inf) + 1e-15 * max(1.0, abs(lo)) + 1e-300
    assert result.sup >= hi >= float(result.sup) - 1e-15 * max(1.0, abs(hi))


RELATIONS: list[tuple[str, Callable[[Interval, Interval], object], Interval, Interval, bool]] = [
    ("subset", Interval.subset, EMPTY, EMPTY, True),
    ("subset", Interval.subset, EMPTY, Interval(1.0), True),
    ("subset", Interval.subset, Interval(1.0), EMPTY, False),
    ("subset", Interval.subset, Interval(1.0, 2.0), Interval(1.0, 3.0), True),
    ("interior", Interval.interior, Interval(1.0, 2.0), Interval(1.0, 3.0), False),
    ("interior", Interval.interior, Interval(1.5, 2.0), Interval(1.0, 3.0), True),
    ("interior", Interval.interior, ENTIRE, ENTIRE, True),
    ("interior", Interval.interior, EMPTY, EMPTY, True),
    ("disjoint", Interval.disjoint, EMPTY, ENTIRE, True),
    ("disjoint", Interval.disjoint, Interval(1.0, 2.0), Interval(2.0, 3.0), False),
    ("less", Interval.less, Interval(1.0, 3.0), Interval(2.0, 4.0), True),
    ("less", Interval.less, EMPTY, EMPTY, True),
    ("less", Interval.less, EMPTY, Interval(1.0), False),
    ("less", Interval.less, Interval(1.0), EMPTY, False),
    ("strict_less", Interval.strict_less, Interval(1.0, 3.0), Interval(1.0, 4.0), False),
    ("strict_less", Interval.strict_less, ENTIRE, ENTIRE, True),
    ("strict_less", Interval.strict_less, EMPTY, EMPTY, True),
    ("precedes", Interval.precedes, Interval(1.0, 2.0), Interval(2.0, 3.0), True),
    ("precedes", Interval.precedes, EMPTY, ENTIRE, True),
    ("strict_precedes", Interval.strict_precedes, Interval(1.0, 2.0), Interval(2.0, 3.0), False),
    ("strict_precedes", Interval.strict_precedes, EMPTY, ENTIRE, True),
    ("strict_precedes", Interval.strict_precedes, Interval(1.0), Interval(2.0), True),
    ("equal", Interval.equal, EMPTY, EMPTY, True),
    ("equal", Interval.equal, Interval(1.0, 2.0), Interval(1.0, 2.0), True),
]


@pytest.mark.parametrize(("name", "relation", "a", "b", "holds"), RELATIONS)
def test_relation_is_as_in_the_standard(
    name: str,
    relation: Callable[[Interval, Interval], object],
    a: Interval,
    b: Interval,
    *,
    holds: bool,
) -> None:
    assert bool(relation(a, b)) is holds, name


@pytest.mark.parametrize(
    ("other", "state"),
    [
        (Interval(5.0, 6.0), "before"),
        (Interval(4.0, 6.0), "meets"),
        (Interval(3.0, 6.0), "overlaps"),
        (Interval(2.0, 6.0), "starts"),
        (Interval(1.0, 6.0), "contained_by"),
        (Interval(1.0, 4.0), "finishes"),
        (Interval(2.0, 4.0), "equals"),
        (Interval(3.0, 4.0), "finished_by"),
        (Interval(2.5, 3.0), "contains"),
        (Interval(2.0, 3.0), "started_by"),
        (Interval(1.0, 3.0), "overlapped_by"),
        (Interval(1.0, 2.0), "met_by"),
        (Interval(0.0, 1.0), "after"),
        (EMPTY, "second_empty"),
    ],
)
def test_overlap_is_one_of_the_standards_states(other: Interval, state: str) -> None:
    assert Interval(2.0, 4.0).overlap(other) == state


def floats(*arrays: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> tuple[float, ...]:
    return tuple(float(array) for array in arrays)


def test_numbers_of_an_interval_are_as_in_the_standard() -> None:
    assert floats(EMPTY.inf, EMPTY.sup) == (INF, -INF)
    for number in (EMPTY.mid, EMPTY.wid, EMPTY.rad, EMPTY.mag, EMPTY.mig):
        assert np.isnan(number)
    assert ENTIRE.mid == 0.0
    assert Interval(0.0, INF).mid == MOST
    assert Interval(-INF, 3.0).mid == -MOST
    assert Interval(-MOST, MOST).mid == 0.0
    assert floats(Interval(1.0, 4.0).mid, Interval(1.0, 4.0).rad, Interval(1.0, 4.0).wid) == (
        2.5,
        1.5,
        3,
    )
    assert floats(ENTIRE.wid, ENTIRE.rad, ENTIRE.mag, ENTIRE.mig) == (INF, INF, INF, 0.0)
    assert floats(Interval(-3.0, 2.0).mag, Interval(-3.0, 2.0).mig) == (3.0, 0.0)
    assert floats(Interval(-3.0, -2.0).mag, Interval(-3.0, -2.0).mig) == (3.0, 2.0)
    assert 0.0 <= float(Interval(0.0, TINY).mid) <= TINY
    assert Interval(1.0).is_singleton
    assert ENTIRE.is_entire
    assert not Interval(0.0, INF).is_common_interval
    assert Interval(0.0, 1.0).is_common_interval
    wide = Interval(0.1, 0.30000000000000004)
    true = Fraction(float(wide.sup)) - Fraction(float(wide.inf))
    assert Fraction(math.nextafter(float(wide.wid), 0.0)) < true <= Fraction(float(wide.wid))
    assert np.array_equal(Interval([0.0, 1.0], [1.0, 2.0]).contains([0.5, 5.0]), [True, False])
    assert not ENTIRE.contains(INF)
