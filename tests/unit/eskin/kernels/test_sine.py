from __future__ import annotations

from typing import TYPE_CHECKING

import flint
import numpy as np
import pytest

from eskin.kernels import sine
from eskin.kernels.jit import part

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

# Loops are compiled as parts, uncached: a cache would not see that the parts in them have changed.
N = 6000


@part
def _sincospi(x: Floats, s: Floats, c: Floats) -> None:
    for i in range(x.size):
        s[i], c[i] = sine.sincospi(x[i])


@part
def _sincospi_of_product(a: Floats, b: Floats, s: Floats, c: Floats) -> None:
    for i in range(a.size):
        s[i], c[i] = sine.sincospi_of_product(a[i], b[i])


@part
def _bounds(values: Floats, lo: Floats, hi: Floats) -> None:
    for i in range(values.size):
        lo[i] = sine.unit_down(values[i])
        hi[i] = sine.unit_up(values[i])


@pytest.fixture(autouse=True)
def _many_bits() -> Iterable[None]:
    before = flint.ctx.prec
    flint.ctx.prec = 1300  # holds every product of two floats exactly where it has a fraction
    yield
    flint.ctx.prec = before


def _angles() -> Floats:
    rng = np.random.default_rng(11)
    quarters = 0.25 * rng.integers(-20, 21, N)
    return np.concatenate(
        [
            rng.uniform(-0.25, 0.25, N),
            rng.uniform(-4.0, 4.0, N),
            quarters + rng.choice([-1.0, 1.0], N) * 2.0 ** -rng.integers(1, 54, N),
            rng.uniform(-1.0, 1.0, N) * 10.0 ** rng.uniform(-300.0, 300.0, N),
            np.ldexp(rng.uniform(-1.0, 1.0, N), rng.integers(-60, 60, N)),
        ]
    )


def _worst(values: Floats, truths: Iterable[flint.arb]) -> float:
    """Greatest error, relative to what is allowed; exact zeros must be met exactly."""
    worst = 0.0
    absolute = flint.arb(sine.ABSOLUTE_ERROR)
    for value, truth in zip(values, truths, strict=True):
        size = abs(truth.mid())
        error = abs(flint.arb(value) - truth).mid()
        allowed = size * flint.arb(sine.RELATIVE_ERROR)
        if size < flint.arb(2.0**-1000):
            allowed += absolute
        ratio = error / allowed if size > 0 else flint.arb(0 if value == 0.0 else 9)
        worst = max(worst, float(ratio))
    return worst


def _contained(values: Floats, truths: Iterable[flint.arb]) -> bool:
    lo, hi = np.empty_like(values), np.empty_like(values)
    _bounds(values, lo, hi)
    assert np.all(np.abs([lo, hi]) <= 1.0)
    return all(
        flint.arb(a) <= truth.mid() <= flint.arb(b)
        for a, b, truth in zip(lo, hi, truths, strict=True)
    )


def test_sine_and_cosine_are_within_their_proven_error() -> None:
    x = _angles()
    s, c = np.empty_like(x), np.empty_like(x)
    _sincospi(x, s, c)
    sines = [flint.arb(v).sin_pi() for v in x]
    cosines = [flint.arb(v).cos_pi() for v in x]
    assert 0.3 < _worst(s, sines) < 1.0
    assert 0.3 < _worst(c, cosines) < 1.0
    assert _contained(s, sines)
    assert _contained(c, cosines)


def test_a_product_of_two_floats_costs_no_ulp_more() -> None:
    rng = np.random.default_rng(12)
    a = np.concatenate(
        [
            rng.uniform(0.0, 1e3, N),
            rng.uniform(-1e12, 1e12, N),
            10.0 ** rng.uniform(-120.0, 120.0, N),
            rng.uniform(0.1, 100.0, N),
        ]
    )
    b = np.concatenate(
        [
            10.0 ** rng.uniform(-9.0, 6.0, N),
            10.0 ** rng.uniform(-6.0, 9.0, N),
            10.0 ** rng.uniform(-120.0, 120.0, N),
            0.25 * rng.integers(1, 400, N),
        ]
    )
    b[-N:] /= a[-N:]  # the product lies beside a quarter turn
    s, c = np.empty_like(a), np.empty_like(a)
    _sincospi_of_product(a, b, s, c)
    products = [flint.arb(p) * flint.arb(q) for p, q in zip(a, b, strict=True)]
    sines, cosines = [p.sin_pi() for p in products], [p.cos_pi() for p in products]
    assert 0.3 < _worst(s, sines) < 1.0
    assert 0.3 < _worst(c, cosines) < 1.0
    assert _contained(s, sines)
    assert _contained(c, cosines)


def test_multiples_of_a_quarter_turn_are_exact() -> None:
    x = np.concatenate([np.arange(-8, 9) / 2, [2.0**53, -(2.0**60), 2.0**52 + 1.0, 1.7e308]])
    s, c = np.empty_like(x), np.empty_like(x)
    _sincospi(x, s, c)
    assert [float(flint.arb(v).sin_pi()) for v in x] == list(s)
    assert [float(flint.arb(v).cos_pi()) for v in x] == list(c)
    lo, hi = np.empty_like(x), np.empty_like(x)
    _bounds(s, lo, hi)
    assert np.all((lo <= s) & (s <= hi) & (hi - lo <= 3.4e-16))
    assert np.all((lo == hi) | (s != 0.0))


def test_subnormal_angles_are_enclosed() -> None:
    x = np.concatenate([5e-324 * np.arange(1, 40), [2.2250738585072014e-308, 1e-310, 3e-307]])
    s, c = np.empty_like(x), np.empty_like(x)
    _sincospi(x, s, c)
    truths = [flint.arb(v).sin_pi() for v in x]
    assert _worst(s, truths) <= 1.0
    assert _contained(s, truths)
    assert np.all(c == 1.0)


def test_subnormal_products_are_enclosed() -> None:
    rng = np.random.default_rng(13)
    a = 10.0 ** rng.uniform(-165.0, -150.0, N)
    b = 10.0 ** rng.uniform(-165.0, -150.0, N)
    s, c = np.empty_like(a), np.empty_like(a)
    _sincospi_of_product(a, b, s, c)
    truths = [(flint.arb(p) * flint.arb(q)).sin_pi() for p, q in zip(a, b, strict=True)]
    lo, hi = np.empty_like(s), np.empty_like(s)
    _bounds(s, lo, hi)
    assert all(
        flint.arb(p) <= truth.mid() <= flint.arb(q)
        for p, q, truth in zip(lo, hi, truths, strict=True)
    )


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_angle_gives_nan(value: float) -> None:
    x = np.array([value])
    s, c = np.empty_like(x), np.empty_like(x)
    _sincospi(x, s, c)
    assert np.isnan(s[0])
    assert np.isnan(c[0])


def test_loops_use_vector_registers_and_call_no_libm() -> None:
    x = _angles()
    _sincospi(x, np.empty_like(x), np.empty_like(x))
    assembly = next(iter(_sincospi.inspect_asm().values()))  # type: ignore[attr-defined]  # numba's
    assert "vmulpd" in assembly or "mulpd" in assembly or "fmul" in assembly
    calls = [line for line in assembly.splitlines() if "call" in line]
    assert not [line for line in calls if any(f in line for f in ("sin", "cos", "rint", "fma"))]
