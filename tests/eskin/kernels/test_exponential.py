from __future__ import annotations

from typing import TYPE_CHECKING

import flint
import numpy as np
import pytest

from eskin.kernels import exponential
from eskin.kernels.compiled import part

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

# Loops are compiled as parts, uncached: a cache would not see that the parts in them have changed.
N = 8000
LARGEST = np.finfo(float).max


@part
def _exp(x: Floats, lo: Floats, out: Floats, hi: Floats) -> None:
    for i in range(x.size):
        lo[i] = exponential.exp_down(x[i])
        out[i] = exponential.exp(x[i])
        hi[i] = exponential.exp_up(x[i])


@part
def _exp_alone(x: Floats, out: Floats) -> None:
    for i in range(x.size):
        out[i] = exponential.exp(x[i])


def _of(x: Floats) -> tuple[Floats, Floats, Floats]:
    lo, out, hi = np.empty_like(x), np.empty_like(x), np.empty_like(x)
    _exp(x, lo, out, hi)
    return lo, out, hi


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


def test_exponential_is_within_its_proven_error() -> None:
    x = _arguments()
    _, out, _ = _of(x)
    worst = 0.0
    for argument, value in zip(x, out, strict=True):
        truth = flint.arb(argument).exp()
        allowed = truth * flint.arb(exponential.RELATIVE_ERROR)
        if argument < -708.0:
            allowed += flint.arb(exponential.ABSOLUTE_ERROR)
        worst = max(worst, float((abs(flint.arb(value) - truth) / allowed).mid()))
    assert 0.3 < worst < 1.0


def test_bounds_enclose_and_are_close() -> None:
    x = _arguments()
    lo, out, hi = _of(x)
    truths = [flint.arb(argument).exp().mid() for argument in x]
    assert all(flint.arb(a) <= t <= flint.arb(b) for a, t, b in zip(lo, truths, hi, strict=True))
    ulps = (hi - lo) / np.spacing(out)
    assert np.all(ulps[out > 1e-300] <= 3.0)
    assert np.all(lo >= 0.0)


def test_ends_of_the_range_are_sound() -> None:
    x = np.array([0.0, -0.0, 709.782712893384, 709.7827128933841, 1e300, np.inf, -745.2, -1e300])
    lo, out, hi = _of(x)
    assert lo[0] == hi[0] == lo[1] == hi[1] == 1.0
    assert out[2] < np.inf
    assert lo[2] < float(flint.arb(x[2]).exp()) < LARGEST
    assert np.all(lo[3:5] <= LARGEST)
    assert np.all(out[3:5] == np.inf)
    assert np.all(hi[3:6] == np.inf)
    assert lo[5] == np.inf
    assert np.all(lo[6:] == 0.0)
    assert np.all(hi[6:] > 0.0)
    assert np.all(hi[6:] <= 1e-323)


def test_minus_infinity_gives_zero_and_nan_stays() -> None:
    lo, out, hi = _of(np.array([-np.inf, np.nan]))
    assert lo[0] == out[0] == 0.0
    assert 0.0 <= hi[0] <= 5e-324
    assert np.isnan([lo[1], out[1], hi[1]]).all()


def test_bounds_are_monotone_across_a_reduction_step() -> None:
    step = 0.5 * np.log(2.0)
    x = np.sort(step * (1.0 + np.linspace(-1e-13, 1e-13, 4001)))
    lo, _, hi = _of(x)
    assert np.all(hi[1:] >= lo[:-1])


def test_loops_use_vector_registers_and_call_no_libm() -> None:
    x = np.linspace(-1.0, 1.0, 100)
    _exp_alone(x, np.empty_like(x))
    assembly = next(iter(_exp_alone.inspect_asm().values()))  # type: ignore[attr-defined]  # numba's
    assert "vmulpd" in assembly or "mulpd" in assembly or "fmul" in assembly
    calls = [line for line in assembly.splitlines() if "call" in line]
    assert not [line for line in calls if any(f in line for f in ("exp", "fma", "rint"))]
