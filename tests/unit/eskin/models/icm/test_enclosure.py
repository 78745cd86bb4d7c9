"""Bounds of thin frequency and phase: against 300 bits at members of the boxes, and how tight."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import flint
import numpy as np
import pytest

from eskin.interval import Interval
from eskin.kernels.jit import part
from eskin.models.icm import ecfes_voltage, magfes_current
from eskin.models.icm.clock import sample_at
from eskin.models.icm.response import ROUNDING, branch, phase_parts, respond
from tests.unit.eskin.models.icm import reference

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tests.unit.eskin.models.icm.reference import Cases, Floats

N = 1200
ALONG = 301


@pytest.fixture(autouse=True)
def _many_bits() -> Iterable[None]:
    before = flint.ctx.prec
    flint.ctx.prec = reference.BITS
    yield
    flint.ctx.prec = before


@part
def _respond_at(
    f: Floats, psi: Floats, t: Floats, tau: Floats, h: Floats, slope: Floats, size: Floats
) -> None:
    for i in range(f.size):
        phase, now = phase_parts(psi[i]), sample_at(f[i], t[i])
        for j in range(tau.shape[1]):
            of = branch(f[i], tau[i, j])
            h[i, j], slope[i, j], size[i, j], _, _ = respond(of, phase, now)


def _members(boxes: Cases, *, coil: bool) -> tuple[Floats, Floats]:
    """Members on the edges of each box (one edge does for R2·C), and inside."""
    r = reference.along(boxes.r.inf, boxes.r.sup, ALONG)
    other = reference.along(boxes.other.inf, boxes.other.sup, ALONG)
    if not coil:
        return r, other
    rng = np.random.default_rng(5)
    inside = rng.random((2, len(r), 60))
    some_r = boxes.r.inf[:, None] + (boxes.r.sup - boxes.r.inf)[:, None] * inside[0]
    some = boxes.other.inf[:, None] + (boxes.other.sup - boxes.other.inf)[:, None] * inside[1]
    flat = np.ones(ALONG)
    all_r = [r, r, boxes.r.inf[:, None] * flat, boxes.r.sup[:, None] * flat, some_r]
    all_other = [
        boxes.other.inf[:, None] * flat, boxes.other.sup[:, None] * flat, other, other, some,
    ]  # fmt: skip
    return np.concatenate(all_r, axis=1), np.concatenate(all_other, axis=1)


def _values(boxes: Cases, r: Floats, other: Floats, *, coil: bool) -> tuple[Floats, Floats]:
    """Values, and the sums of sizes that their rounding is measured by."""
    h, slope, size = np.empty((3, *r.shape))
    _respond_at(boxes.f, boxes.psi, boxes.t, other / r if coil else r * other, h, slope, size)
    return (h / r, size / r) if coil else (h, size)


@pytest.mark.parametrize("coil", [False, True])
@pytest.mark.parametrize("seed", [1, 2])
def test_bounds_enclose_all_members_and_no_more(seed: int, *, coil: bool) -> None:
    boxes = reference.cases(seed, N, coil=coil)
    source: dict[str, Any] = {"amplitude": 1.0, "frequency": boxes.f, "phase": boxes.psi}
    if coil:
        got = magfes_current(boxes.t, **source, coil_resistance=boxes.r, inductance=boxes.other)
    else:
        got = ecfes_voltage(
            boxes.t, **source, capacitor_resistance=boxes.r, capacitance=boxes.other
        )
    r, other = _members(boxes, coil=coil)
    values, size = _values(boxes, r, other, coil=coil)
    truth = reference.current if coil else reference.voltage
    rng = np.random.default_rng(seed)
    exact = np.empty((2, N))
    for i in range(N):
        ends = int(values[i].argmin()), int(values[i].argmax())
        for j in (*ends, 0, ALONG - 1, int(rng.integers(values.shape[1]))):
            at = truth(boxes.f[i], boxes.psi[i], boxes.t[i], r[i, j], other[i, j])
            assert reference.inside(got.inf[i], got.sup[i], at), (i, j)
            if j in ends:
                exact[ends.index(j), i] = float(at)
    exact[1] = np.where(values.argmin(axis=1) == values.argmax(axis=1), exact[0], exact[1])
    true_width = exact[1] - exact[0]
    # Samples miss a part of the true width of (1/300)² or so: the rest is ours.
    allowed = 1.0002 * true_width + 1e-10 * size.max(axis=1) + 1e-300
    assert np.all(got.sup - got.inf <= allowed)
    assert np.mean(got.sup - got.inf <= 1.000001 * true_width + 1e-13 * size.max(axis=1)) > 0.9


def test_bounds_are_exact_where_monotone() -> None:
    rng = np.random.default_rng(3)
    t = rng.uniform(0.0, 5e-3, N)  # ωt <= π/2 and ψ = 0: both fall with each parameter
    r, c = rng.uniform(100.0, 5000.0, N), 10.0 ** rng.uniform(-8.0, -5.0, N)
    big_r, big_c = Interval(0.95 * r, 1.05 * r), Interval(0.95 * c, 1.05 * c)
    got = ecfes_voltage(
        t, amplitude=1.0, frequency=50.0, phase=0.0, capacitor_resistance=big_r, capacitance=big_c
    )
    for i in range(N):
        top = reference.voltage(50.0, 0.0, t[i], big_r.inf[i], big_c.inf[i])
        bottom = reference.voltage(50.0, 0.0, t[i], big_r.sup[i], big_c.sup[i])
        true_width = float(top - bottom)
        assert got.sup[i] - got.inf[i] <= (1.0 + 1e-9) * true_width + 1e-14 * float(top)


@pytest.mark.parametrize("resistance", [1.0, 10e3])
@pytest.mark.parametrize("phase", [0.0, np.deg2rad(-46.0), 2.0])
def test_thin_parameters_hold_the_plain_formula_within_a_few_ulp(
    resistance: float, phase: float
) -> None:
    t = np.linspace(1e-3, 20e-3, 500)
    got = magfes_current(
        t, amplitude=5.0, frequency=50.0, phase=phase, coil_resistance=resistance, inductance=1e-3
    )
    omega, tau = 2.0 * np.pi * 50.0, 1e-3 / resistance
    x, theta = omega * tau, omega * t + phase
    plain = np.sin(theta) - x * np.cos(theta)
    plain -= (np.sin(phase) - x * np.cos(phase)) * np.exp(-t / tau)
    plain *= 5.0 / resistance / (1.0 + x * x)
    peak = np.max(np.abs(plain))
    assert np.all(
        np.abs(plain - got.inf) <= 64 * np.spacing(peak)
    )  # what the formula may be off by
    width = (got.sup - got.inf) / np.spacing(np.abs(plain))
    assert np.median(width) <= 2.0
    assert np.all(got.sup - got.inf <= 4 * np.spacing(peak))


@pytest.mark.parametrize("t", [5e-324, 1e-310, 1e-200, 1e-30, 1e-12])
@pytest.mark.parametrize("phase", [0.0, 0.7])
def test_tiny_times_are_enclosed_and_relatively_tight(t: float, phase: float) -> None:
    got = ecfes_voltage(
        t, amplitude=5.0, frequency=50.0, phase=phase, capacitor_resistance=2419.0,
        capacitance=Interval(0.95e-6, 1.05e-6),
    )  # fmt: skip
    flint.ctx.prec = 6000  # the plain formula cancels to nothing here
    for c in (0.95e-6, 1e-6, 1.05e-6):
        truth = 5 * reference.voltage(50.0, phase, t, 2419.0, c)
        assert reference.inside(float(got.inf), float(got.sup), truth)
    if t > 1e-100 or (phase and t > 1e-300):
        assert got.sup <= 1.1053 * got.inf


def test_large_times_lose_nothing() -> None:
    t = np.array([1.0, 1e3, 1e6, 1e9]) + 1.0 / 3.0
    got = ecfes_voltage(
        t, amplitude=1.0, frequency=50.0, phase=0.3, capacitor_resistance=1e3, capacitance=1e-6
    )
    for i in range(len(t)):
        truth = reference.voltage(50.0, 0.3, t[i], 1e3, 1e-6)
        assert reference.inside(got.inf[i], got.sup[i], truth)
    assert np.all(got.sup - got.inf < 2e-14)


def test_rounding_stays_within_half_of_its_bound() -> None:
    boxes = reference.cases(9, 4000, coil=False)
    tau = (boxes.r.inf * boxes.other.inf)[:, None]
    h, slope, size = np.empty((3, *tau.shape))
    _respond_at(boxes.f, boxes.psi, boxes.t, tau, h, slope, size)
    worst = 0.0
    for i in range(len(tau)):
        truth = reference.response(boxes.f[i], flint.arb(tau[i, 0]), boxes.psi[i], boxes.t[i])
        error = abs(flint.arb(h[i, 0]) - truth) / flint.arb(size[i, 0])
        worst = max(worst, float(error.mid()))
    assert 0.1 * ROUNDING < worst < 0.6 * ROUNDING


@pytest.mark.parametrize("phase", [-5e-324, Interval(-5e-324, -5e-324)])
@pytest.mark.parametrize("frequency", [0.0, Interval(0.0, 1e-3)])
def test_underflow_is_weighed_as_the_branch_of_least_resistance(
    phase: float | Interval, frequency: float | Interval
) -> None:
    """Its ``h`` is 1e38 times as much in units of the greatest resistance."""
    found = magfes_current(
        2.0, amplitude=5e20, frequency=frequency, phase=phase,
        coil_resistance=Interval(100.0, 1e40), inductance=Interval(1e-5, 2e-5),
    )  # fmt: skip
    steady = flint.arb(5e20) * flint.arb(5e-324) / 100
    assert float(found.inf) <= float(-steady)
