"""Operators on runs of ticks, against their definitions in dense time."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.monitor.runs import END, Runs, at_least
from tests.unit.eskin.monitor.formulas import bounds
from tests.unit.eskin.monitor.worlds import FAR, quarters

if TYPE_CHECKING:
    from collections.abc import Callable

TICKS = range(-12, 30)
WINDOWS = bounds(5, unbounded=True)


@st.composite
def sets(draw: st.DrawFn) -> Runs:
    edges = sorted(draw(st.lists(st.integers(-6, 24), max_size=6)))
    first, last = edges[::2], edges[1::2]
    if len(first) > len(last):
        last.append(END)
    if draw(st.booleans()) and first:
        first[0] = -END
    return Runs.of(np.array(first, np.int64), np.array(last, np.int64))


def members(runs: Runs) -> list[bool]:
    return [bool(each) for each in runs.contains(np.array(TICKS))]


def in_dense_time(runs: Runs) -> Callable[[Fraction], bool]:
    grid = quarters(Fraction(-40), Fraction(60))
    ticks = [2 * int(t // 1) + (t.denominator != 1) for t in grid]
    known = dict(zip(grid, runs.contains(np.array(ticks)).tolist(), strict=True))
    return known.__getitem__


def times() -> list[Fraction]:
    return [Fraction(tick, 2) for tick in TICKS]


@given(sets(), sets(), sets(), st.integers(-1, 4))
def test_sets_combine(p: Runs, q: Runs, r: Runs, number: int) -> None:
    one, two, three = members(p), members(q), members(r)
    assert members(~p) == [not each for each in one]
    assert members(p & q) == [x and y for x, y in zip(one, two, strict=True)]
    assert members(p | q) == [x or y for x, y in zip(one, two, strict=True)]
    counts = [sum(each) for each in zip(one, two, three, strict=True)]
    assert members(at_least((p, q, r), number)) == [count >= number for count in counts]
    for runs in (~p, p & q, p | q):
        assert np.all(runs.first <= runs.last)
        assert np.all(runs.first[1:] - 1 > runs.last[:-1])


@settings(max_examples=40)
@given(sets(), WINDOWS)
def test_windows_follow_their_definition(p: Runs, window: tuple[int, int | None]) -> None:
    a, b = window
    end = FAR if b is None else b
    holds = in_dense_time(p)
    ahead = [[holds(each) for each in quarters(t + a, t + end)] for t in times()]
    back = [[holds(each) for each in quarters(t - end, t - a)] for t in times()]
    assert members(p.eventually(a, b)) == [any(each) for each in ahead]
    assert members(p.always(a, b)) == [all(each) for each in ahead]
    assert members(p.once(a, b)) == [any(each) for each in back]
    assert members(p.historically(a, b)) == [all(each) for each in back]


@settings(max_examples=40)
@given(sets(), sets(), WINDOWS)
def test_until_and_since_follow_their_definition(
    p: Runs, q: Runs, window: tuple[int, int | None]
) -> None:
    a, b = window
    end = FAR if b is None else b
    left, right = in_dense_time(p), in_dense_time(q)

    def until(t: Fraction) -> bool:
        return any(
            right(then) and all(left(each) for each in quarters(t, then) if each != then)
            for then in quarters(t + a, t + end)
        )

    def since(t: Fraction) -> bool:
        return any(
            right(then) and all(left(each) for each in quarters(then, t) if each != then)
            for then in quarters(t - end, t - a)
        )

    assert members(p.until(q, a, b)) == [until(t) for t in times()]
    assert members(p.since(q, a, b)) == [since(t) for t in times()]


@given(sets())
def test_just_before_is_the_limit_from_below(p: Runs) -> None:
    holds = in_dense_time(p)
    assert members(p.just_before()) == [holds(t - Fraction(1, 4)) for t in times()]


@pytest.mark.parametrize("operator", ["eventually", "always", "once", "historically"])
def test_what_has_no_end_keeps_none(operator: str) -> None:
    everything = Runs.between(-END, END)
    found = getattr(everything, operator)(3, 2**57)
    assert (found.first.tolist(), found.last.tolist()) == ([-END], [END])
