"""What a q-relaxed intersection may claim, against the exact distribution in fractions."""

from __future__ import annotations

from fractions import Fraction
from math import comb

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.errors import IdentificationError
from eskin.identification import independent_coverage, relaxed_coverage
from eskin.union_bound import union_coverage

COVERAGES = st.floats(0.0, 1.0) | st.floats(0.9, 1.0) | st.just(1.0 - 2.0**-53)


@given(COVERAGES, st.integers(0, 60), st.integers(0, 60))
def test_claims_are_not_above_the_binomial_probability(c: float, n: int, q: int) -> None:
    right, wrong = Fraction(c), 1 - Fraction(c)
    exact = sum(comb(n, k) * wrong**k * right ** (n - k) for k in range(min(q, n) + 1))
    assert Fraction(relaxed_coverage(c, n, q)) <= Fraction(independent_coverage(c, n, q)) <= exact


@given(COVERAGES, st.integers(1, 60), st.integers(0, 60))
def test_claim_holds_for_the_worst_dependence(c: float, n: int, q: int) -> None:
    """q + 1 constraints are wrong at once, or none: as often as their coverage allows."""
    together = min(Fraction(1), n * (1 - Fraction(c)) / (q + 1))
    assert Fraction(relaxed_coverage(c, n, q)) <= 1 - together


@given(COVERAGES, st.integers(1, 10**6))
def test_without_outliers_it_is_the_union_bound(c: float, n: int) -> None:
    assert relaxed_coverage(c, n, 0) == union_coverage(c, n=n)


def test_claims_say_something() -> None:
    assert independent_coverage(0.9973, 10_080, 80) > 1.0 - 1e-12
    assert relaxed_coverage(1.0 - 1e-9, 10_080, 3) > 0.99999
    assert relaxed_coverage(1.0, 10_080, 0) == independent_coverage(1.0, 10_080, 0) == 1.0


@pytest.mark.parametrize("given_", [(1.5, 1, 1), (-0.1, 1, 1), (0.9, -1, 1), (0.9, 1, -1)])
def test_what_is_no_coverage_is_refused(given_: tuple[float, int, int]) -> None:
    for claim in (relaxed_coverage, independent_coverage):
        with pytest.raises(IdentificationError):
            claim(*given_)
