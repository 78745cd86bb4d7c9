"""A set of numbers has one zero: -0.0 as a bound means what 0.0 means."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from eskin.interval import Interval
from tests.unit.eskin.interval.exact import BINARY, UNARY

BOUNDS = (-np.inf, -1.0, -0.0, 0.0, 1.0, np.inf)
PAIRS = [
    pair for pair in product(BOUNDS, repeat=2) if pair[0] <= pair[1] and np.isfinite(pair).any()
]
SIGNED = Interval(*np.array(PAIRS).T)
PLAIN = Interval(SIGNED.inf + 0.0, SIGNED.sup + 0.0)


@pytest.mark.parametrize("name", UNARY)
def test_function_takes_both_zeros_alike(name: str) -> None:
    function = UNARY[name][0]
    signed, plain = function(SIGNED), function(PLAIN)
    assert np.array_equal(signed.inf, plain.inf)
    assert np.array_equal(signed.sup, plain.sup)


@pytest.mark.parametrize("name", BINARY)
def test_function_of_two_takes_both_zeros_alike(name: str) -> None:
    function = BINARY[name][0]
    signed = function(SIGNED[:, None], SIGNED[None, :])
    plain = function(PLAIN[:, None], PLAIN[None, :])
    assert np.array_equal(signed.inf, plain.inf)
    assert np.array_equal(signed.sup, plain.sup)
