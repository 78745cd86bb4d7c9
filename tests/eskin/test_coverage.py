"""What a statement about many samples can claim is rounded down, and never too high."""

from __future__ import annotations

import math
from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from eskin.coverage import union_coverage


@given(st.floats(0.0, 1.0), st.integers(1, 10**9))
def test_union_coverage_is_never_too_high(coverage: float, n: int) -> None:
    exact = max(Fraction(0), 1 - n * (1 - Fraction(coverage)))
    found = union_coverage(coverage, n)
    assert found >= 0.0
    assert Fraction(found) <= exact
    assert Fraction(math.nextafter(found, 2.0)) > exact
