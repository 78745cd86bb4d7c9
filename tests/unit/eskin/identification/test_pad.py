"""Constraints of a pad's samples hold its true parameters, by its model in fractions."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eskin.errors import IdentificationError
from eskin.identification import rest_capacitance, stiffness
from eskin.interval import Interval

SEEDS = st.integers(0, 2**32 - 1)
UNKNOWN = Interval(-np.inf, np.inf)


class Pad:
    """A sample of a pad, in fractions, with intervals around all that is measured."""

    def __init__(self, seed: int, *, load: float | None = None) -> None:
        self._draw = np.random.default_rng(seed)
        self.rest = Fraction(float(self._draw.uniform(1e-12, 1e-10)))
        self.stiffness = Fraction(float(self._draw.uniform(1e4, 1e6)))
        force = float(self._draw.uniform(0.0, 5e4)) if load is None else load
        self.load = Fraction(force)
        self.air = Fraction(float(self._draw.uniform(0.9, 1.1)))
        self.residual = float(self._draw.choice([0.0, 0.02]))
        remains = Fraction(self.residual) * Fraction(float(self._draw.uniform()))
        self.capacitance = self.rest * self.air * (1 + self.load / self.stiffness + remains)

    def around(self, exact: Fraction, spread: float) -> Interval:
        """An interval that holds a number, as thin as may be at times."""
        width = spread * float(self._draw.choice([0.0, 1.0]))
        lo = float(exact) * (1.0 - width * float(self._draw.uniform()))
        hi = float(exact) * (1.0 + width * float(self._draw.uniform()))
        return Interval(np.nextafter(lo, -1.0) if lo else 0.0, np.nextafter(hi, np.inf))


def holds(interval: Interval, exact: Fraction) -> bool:
    lo, hi = float(interval.inf), float(interval.sup)
    return Fraction(lo) <= exact and (hi == np.inf or exact <= Fraction(hi))


@given(seed=SEEDS, at_rest=st.booleans())
def test_rest_capacitance_holds_the_product(seed: int, *, at_rest: bool) -> None:
    pad = Pad(seed, load=0.0 if at_rest else None)
    measured, air = pad.around(pad.capacitance, 1e-2), pad.around(pad.air, 1e-3)
    found = rest_capacitance(measured, air, at_rest=at_rest, residual=pad.residual)
    assert holds(found, pad.rest)
    assert (float(found.inf) > 0.0) == at_rest


@given(SEEDS)
def test_unloaded_sample_is_as_tight_as_it_is_measured(seed: int) -> None:
    pad = Pad(seed, load=0.0)
    assume(pad.residual == 0.0)
    found = rest_capacitance(pad.around(pad.capacitance, 1e-2), float(pad.air), at_rest=True)
    assert float(found.wid) <= 2.1e-2 * float(pad.rest)


@given(SEEDS)
def test_stiffness_holds_the_true_one(seed: int) -> None:
    pad = Pad(seed)
    found = stiffness(
        pad.around(pad.capacitance, 1e-2),
        pad.around(pad.load, 1e-2),
        pad.around(pad.rest, 1e-3),
        pad.around(pad.air, 1e-3),
        residual=pad.residual,
    )
    assert holds(found, pad.stiffness)


def test_common_factor_of_both_capacitances_cancels() -> None:
    pad, factor = Pad(2, load=2e4), 1.02  # an oscillator that is 2 % off
    assert pad.residual == 0.0
    raw = stiffness(
        Interval.relative(factor * float(pad.capacitance), 1e-4),
        Interval.relative(float(pad.load), 1e-4),
        Interval.relative(factor * float(pad.rest), 1e-4),
        float(pad.air),
    )
    assert holds(raw, pad.stiffness)
    assert float(raw.wid) < 0.02 * float(pad.stiffness)


def test_nothing_is_said_without_a_load() -> None:
    some = Interval(1.1e-11, 1.2e-11)
    assert str(stiffness(some, 0.0, 1e-11)) == "[0, inf]"
    assert str(stiffness(Interval(0.5e-11, 0.6e-11), 1e4, 1e-11)) == "[0, inf]"
    assert str(stiffness(UNKNOWN, Interval(1e4, 2e4), 1e-11)) == "[0, inf]"


@pytest.mark.parametrize("sample", [UNKNOWN, Interval(-np.inf, 8e-12), Interval(1e-11, np.inf)])
def test_saturated_sample_says_nothing(sample: Interval) -> None:
    """An open line has no capacitance: a bound from above is none of the pad's."""
    assert str(rest_capacitance(sample, at_rest=True)) == "[0, inf]"
    assert str(stiffness(sample, 1e4, 1e-11)) == "[0, inf]"


SOME = Interval(1e-11, 2e-11)


@pytest.mark.parametrize(
    "call",
    [
        lambda: rest_capacitance(SOME, 0.0),
        lambda: rest_capacitance(SOME, residual=-0.1),
        lambda: rest_capacitance(Interval(-2.0, -1.0)),
        lambda: stiffness(SOME, -1.0, 1e-11),
        lambda: stiffness(SOME, 1.0, 0.0),
    ],
)
def test_what_no_pad_has_is_refused(call: Any) -> None:
    with pytest.raises(IdentificationError):
        call()
