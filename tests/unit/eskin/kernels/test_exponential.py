from __future__ import annotations

from typing import TYPE_CHECKING

import flint
import numpy as np
import pytest

from eskin.kernels import exponential
from eskin.kernels.jit import part

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

# Loops are compiled as parts, uncached: a cache would not see that the parts in them have changed.
N = 8000
LARGEST = np.finfo(float).max


@part
def _exp(x: Floats, lo: Floats, hi: Floats) -> None:
    for i in range(x.size):
        lo[i], hi[i] = exponential.exp_down(x[i]), exponential.exp_up(x[i])


def _of(x: Floats) -> tuple[Floats, Floats]:
    lo, hi = np.empty_like(x), np.empty_like(x)
    _exp(x, lo, hi)
    return lo, hi


@pytest.fixture(autouse=True)
def _many_bits() -> Iterable[None]:
    before = flint.ctx.prec
    flint.ctx.prec = 200
    yield
    flint.ctx.prec = before


def _arguments() -> Floats:
    rng = np.random.default_rng(21)
    halves = (rng.integers(-1020, 1020, N) + 0.5) * np.log(2.0)  # where the reduction is longest
    return np.concatenate(
        [
            rng.uniform(-0.35, 0.35, N),
            rng.uniform(-708.0, 709.78, N),
            rng.uniform(-1.0, 1.0, N) * 10.0 ** rng.uniform(-20.0, 2.0, N),
            halves * (1.0 + rng.uniform(-1e-15, 1e-15, N)),
            rng.uniform(-760.0, -708.0, N),
        ]
    )


def test_bounds_enclose_and_are_close() -> None:
    x = _arguments()
    lo, hi = _of(x)
    truths = [flint.arb(argument).exp() for argument in x.tolist()]
    assert all(
        flint.arb(a) <= t <= flint.arb(b)
        for a, t, b in zip(lo.tolist(), truths, hi.tolist(), strict=True)
    )
    apart = hi.view(np.int64) - lo.view(np.int64)  # they are positive: floats between them
    assert np.max(apart[x > -700.0]) <= 2
    assert np.all(lo >= 0.0)


def test_bounds_are_nearly_always_neighbours() -> None:
    """A bound misses the tightest one where a float lies closer to the truth than 0.0032 u."""
    x = _arguments()
    lo, hi = _of(x)
    apart = hi.view(np.int64) - lo.view(np.int64)
    assert 0.99 < np.mean(apart == 1) < 1.0
    subnormal = x < -709.0
    assert np.mean(apart[subnormal] == 1) > 0.999


def test_ends_of_the_range_are_sound() -> None:
    x = np.array([0.0, -0.0, 709.782712893384, 709.7827128933841, 1e300, np.inf, -745.2, -1e300])
    lo, hi = _of(x)
    assert lo[0] == hi[0] == lo[1] == hi[1] == 1.0
    assert flint.arb(lo[2]) < flint.arb(x[2]).exp() < LARGEST
    assert np.all(lo[3:5] <= LARGEST)
    assert np.all(hi[3:6] == np.inf)
    assert lo[5] == np.inf
    assert np.all(lo[6:] == 0.0)
    assert np.all(hi[6:] > 0.0)
    assert np.all(hi[6:] <= 1e-323)


def test_minus_infinity_gives_zero_and_nan_stays() -> None:
    lo, hi = _of(np.array([-np.inf, np.nan]))
    assert lo[0] == 0.0
    assert 0.0 <= hi[0] <= 5e-324
    assert np.isnan([lo[1], hi[1]]).all()


def test_bounds_are_monotone_across_a_reduction_step() -> None:
    step = 0.5 * np.log(2.0)
    x = np.sort(step * (1.0 + np.linspace(-1e-13, 1e-13, 4001)))
    lo, hi = _of(x)
    assert np.all(hi[1:] >= lo[:-1])


def test_loops_use_vector_registers_and_call_no_libm() -> None:
    _of(np.linspace(-1.0, 1.0, 100))
    assembly = next(iter(_exp.inspect_asm().values()))  # type: ignore[attr-defined]  # numba's
    assert "vmulpd" in assembly or "mulpd" in assembly or "fmul" in assembly
    calls = [line for line in assembly.splitlines() if "call" in line]
    assert not [line for line in calls if any(f in line for f in ("exp", "fma", "rint"))]
