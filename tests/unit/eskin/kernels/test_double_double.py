"""Functions in two words are within the error that their bounds allow for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import flint
import numpy as np
import pytest

from eskin.kernels import (
    arctangent,
    double_double,
    exponential,
    large_angles,
    logarithm,
    trig_double_double,
)
from eskin.kernels.jit import part

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

N = 2000
RANDOM = np.random.default_rng(31)
WIDE = 10.0 ** RANDOM.uniform(-200.0, 300.0, N)
SMALL = 10.0 ** RANDOM.uniform(-20.0, 2.0, N)
BESIDE_ONE = 1.0 + RANDOM.uniform(-0.5, 1.0, N) * 10.0 ** RANDOM.uniform(-15.0, 0.0, N)
POSITIVE = np.concatenate([WIDE, SMALL, BESIDE_ONE, RANDOM.uniform(0.0, 2.0, N)])
UNIT = POSITIVE[POSITIVE < 1.0]
TURNS = RANDOM.integers(-(2**47), 2**47, N) * (0.5 * np.pi)  # beside a zero of sine or cosine
ANGLES = np.concatenate([POSITIVE[POSITIVE < 2.0**48], TURNS, np.arange(1.0, 99.0) * np.pi / 4.0])
NEAREST = 6381956970095103.0 * 2.0**797  # no float comes nearer to a multiple of π/2
FAR = np.concatenate([[2.0**48, NEAREST], 10.0 ** RANDOM.uniform(14.5, 308.0, N)])
EXPONENTS = np.concatenate([RANDOM.uniform(-600.0, 700.0, N), RANDOM.uniform(-1.0, 1.0, N), -SMALL])


@part
def exp(x: float) -> double_double.Two:
    return exponential.exp_of_two((x, 0.0), 0)


@part
def expm1(x: float) -> double_double.Two:
    return exponential.expm1_of_two((x, 0.0))


@part
def log(x: float) -> double_double.Two:
    return logarithm.log_of_two((x, 0.0))


@part
def log1p(x: float) -> double_double.Two:
    return logarithm.log1p_of_two((x, 0.0), 0.0)


@part
def atan(x: float) -> double_double.Two:
    return arctangent.angle_of((x, 0.0), (1.0, 0.0))


@part
def acos(x: float) -> double_double.Two:
    return arctangent.angle_of(arctangent.cosine_of(x), (x, 0.0))


@part
def sin(x: float) -> double_double.Two:
    return trig_double_double.sine_of(trig_double_double.reduced(x))


@part
def cos(x: float) -> double_double.Two:
    return trig_double_double.sine_and_cosine(trig_double_double.reduced(x))[1]


@part
def sin_far(x: float) -> double_double.Two:
    return trig_double_double.sine_of(large_angles.reduced_of_any(x))


@part
def cos_far(x: float) -> double_double.Two:
    return trig_double_double.sine_and_cosine(large_angles.reduced_of_any(x))[1]


@part
def sinpi(x: float) -> double_double.Two:
    return trig_double_double.sine_and_cosine(trig_double_double.reduced_of_half_turns(x, 0.0))[0]


@part
def cospi(x: float) -> double_double.Two:
    return trig_double_double.sine_and_cosine(trig_double_double.reduced_of_half_turns(x, 0.0))[1]


@pytest.fixture(autouse=True)
def _many_bits() -> Iterable[None]:
    before = flint.ctx.prec
    flint.ctx.prec = 1400
    yield
    flint.ctx.prec = before


@pytest.mark.parametrize(
    ("function", "truth", "arguments"),
    [
        (exp, flint.arb.exp, EXPONENTS),
        (expm1, flint.arb.expm1, EXPONENTS),
        (log, flint.arb.log, POSITIVE),
        (log1p, flint.arb.log1p, np.concatenate([POSITIVE, -UNIT])),
        (logarithm.log2_of, lambda x: x.log() / flint.arb(2).log(), POSITIVE),
        (logarithm.log10_of, lambda x: x.log() / flint.arb(10).log(), POSITIVE),
        (logarithm.asinh_of, flint.arb.asinh, POSITIVE),
        (logarithm.acosh_of, flint.arb.acosh, POSITIVE[POSITIVE > 1.0]),
        (logarithm.atanh_of, flint.arb.atanh, UNIT),
        (exponential.exp2_of, lambda x: (x * flint.arb(2).log()).exp(), EXPONENTS),
        (exponential.exp10_of, lambda x: (x * flint.arb(10).log()).exp(), EXPONENTS / 3.0),
        (atan, flint.arb.atan, POSITIVE),
        (acos, flint.arb.acos, UNIT),
        (sin, flint.arb.sin, ANGLES),
        (cos, flint.arb.cos, ANGLES),
        (sin_far, flint.arb.sin, FAR),
        (cos_far, flint.arb.cos, FAR),
        (sin_far, flint.arb.sin, -FAR),
        (sinpi, flint.arb.sin_pi, POSITIVE[POSITIVE % 1.0 != 0.0]),
        (cospi, flint.arb.cos_pi, POSITIVE[POSITIVE % 1.0 != 0.5]),
    ],
)
def test_function_is_within_half_of_its_error(
    function: Callable[[float], double_double.Two],
    truth: Callable[[Any], Any],
    arguments: Floats,
) -> None:
    allowed = flint.arb(0.5 * double_double.RELATIVE_ERROR)
    worst = 0.0
    for x in arguments.tolist():
        high, low = function(x)
        exact = truth(flint.arb(x))
        error = abs(flint.arb(high) + flint.arb(low) - exact) / abs(exact) / allowed
        worst = max(worst, float(error.mid()))
    assert worst < 1.0
    assert worst > 1e-4  # what is tested is not exact by some other way
