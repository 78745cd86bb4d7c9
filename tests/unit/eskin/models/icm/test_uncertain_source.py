"""Interval frequency and phase."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import flint
import numpy as np
import pytest

from eskin.interval import Interval
from eskin.models.icm import ecfes_voltage, magfes_current, source_voltage
from tests.unit.eskin.models.icm import reference

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tests.unit.eskin.models.icm.reference import Floats


@pytest.fixture(autouse=True)
def _many_bits() -> Iterable[None]:
    before = flint.ctx.prec
    flint.ctx.prec = reference.BITS
    yield
    flint.ctx.prec = before


def _h(f: Floats, psi: Floats, tau: Floats, t: float) -> Floats:
    omega = 2.0 * np.pi * f
    x, theta = omega * tau, omega * t + psi
    settled = np.sin(theta) - x * np.cos(theta)
    return (settled - (np.sin(psi) - x * np.cos(psi)) * np.exp(-t / tau)) / (1.0 + x * x)


def _box(rng: np.random.Generator, n: int) -> Floats:
    """Members (f, ψ, R, other) of [49, 51] × [-0.9, -0.7] × …, many at their ends."""
    shares = rng.random((4, n))
    ends = rng.random((4, n)) < 0.5
    return np.where(ends, np.round(shares), shares)


@pytest.mark.parametrize("coil", [False, True])
@pytest.mark.parametrize("half_phase", [0.0, 0.1, 2.0])
@pytest.mark.parametrize("half_frequency", [0.0, 1e-6, 1.0])
def test_bounds_enclose_all_members_and_no_more(
    half_phase: float, half_frequency: float, *, coil: bool
) -> None:
    rng = np.random.default_rng(8)
    times = np.array([0.0, 1e-9, 3e-4, 2e-3, 7e-3, 0.0135, 0.1])
    f = Interval(50.0 - half_frequency, 50.0 + half_frequency)
    psi = Interval(-0.8 - half_phase, -0.8 + half_phase)
    r, other = Interval(0.9, 1.1), Interval(2e-3, 2.4e-3)
    source: dict[str, Any] = {"amplitude": 1.0, "frequency": f, "phase": psi}
    if coil:
        got = magfes_current(times, **source, coil_resistance=r, inductance=other)
    else:
        got = ecfes_voltage(times, **source, capacitor_resistance=r, capacitance=other)
    for i, t in enumerate(times):
        shares = _box(rng, 40_000)
        box = (f, psi, r, other)
        z = [b.inf + (b.sup - b.inf) * share for b, share in zip(box, shares, strict=True)]
        tau = z[3] / z[2] if coil else z[2] * z[3]
        values = _h(z[0], z[1], tau, float(t)) / (z[2] if coil else 1.0)
        for j in (int(values.argmin()), int(values.argmax()), 0, 1, 2):
            member = [float(v[j]) for v in z]
            truth = reference.current if coil else reference.voltage
            at = truth(member[0], member[1], float(t), member[2], member[3])
            assert reference.inside(got.inf[i], got.sup[i], at), (t, member)
        if t > 1e-6:  # below, the plain formula cancels
            assert got.sup[i] - got.inf[i] <= 1.03 * np.ptp(values)


def test_phase_of_a_whole_turn_gives_the_whole_amplitude() -> None:
    t = np.array([0.5, 1.0])
    got = ecfes_voltage(
        t, amplitude=1.0, frequency=50.0, phase=Interval(0.0, 6.3), capacitor_resistance=1e3,
        capacitance=1e-6,
    )  # fmt: skip
    amplitude = 1.0 / np.hypot(1.0, 2.0 * np.pi * 50.0 * 1e-3)
    np.testing.assert_allclose(got.sup, amplitude, rtol=3e-4)
    np.testing.assert_allclose(got.inf, -amplitude, rtol=3e-4)
    assert np.all(got.sup >= amplitude * (1.0 - 1e-15))


def test_frequency_from_zero_is_enclosed() -> None:
    got = ecfes_voltage(
        2e-3, amplitude=1.0, frequency=Interval(0.0, 50.0), phase=0.5, capacitor_resistance=1e3,
        capacitance=1e-6,
    )  # fmt: skip
    for f in (0.0, 1e-9, 1.0, 20.0, 50.0):
        truth = reference.voltage(f, 0.5, 2e-3, 1e3, 1e-6)
        assert reference.inside(float(got.inf), float(got.sup), truth)


def test_many_turns_of_uncertainty_stay_within_the_amplitude() -> None:
    got = ecfes_voltage(
        1e4, amplitude=1.0, frequency=Interval(49.0, 51.0), phase=0.0, capacitor_resistance=1e3,
        capacitance=1e-6,
    )  # fmt: skip
    amplitude = 1.0 / np.hypot(1.0, 2.0 * np.pi * 49.0 * 1e-3)
    assert amplitude <= got.sup <= 1.001 * amplitude


@pytest.mark.parametrize("half_width", [0.2, 3.2157])
def test_phase_that_makes_up_for_frequency_leaves_the_amplitude(half_width: float) -> None:
    psi = Interval(-3.2, 3.2)
    got = ecfes_voltage(
        1.3447, amplitude=1.0, frequency=Interval(50.0 - half_width, 50.0 + half_width), phase=psi,
        capacitor_resistance=Interval(900.0, 1100.0), capacitance=1e-6,
    )  # fmt: skip
    amplitude = 1.0 / np.hypot(1.0, 2.0 * np.pi * (50.0 - half_width) * 0.9e-3)
    for reached in (got.sup, -got.inf):
        assert amplitude * (1.0 - 1e-12) <= reached <= 1.001 * amplitude


@pytest.mark.parametrize("half_frequency", [0.0, 1e-9, 0.5])
@pytest.mark.parametrize("half_phase", [0.0, 1e-9, 1.0])
def test_source_encloses_all_members_and_no_more(half_frequency: float, half_phase: float) -> None:
    rng = np.random.default_rng(6)
    t = np.concatenate([[-1.0, 0.0], 10.0 ** rng.uniform(-9.0, 1.0, 300)])
    f, psi = Interval(50.0 - half_frequency, 50.0 + half_frequency), rng.uniform(-4.0, 4.0, 302)
    phase = Interval(psi - half_phase, psi + half_phase)
    got = source_voltage(t, amplitude=Interval(4.9, 5.0), frequency=f, phase=phase)
    assert got.inf[0] == got.sup[0] == 0.0
    shares = rng.random((2, 2000, len(t)))
    shares = np.where(rng.random(shares.shape) < 0.3, np.round(shares), shares)
    fs = f.inf + (f.sup - f.inf) * shares[0]
    phases = phase.inf + (phase.sup - phase.inf) * shares[1]
    angles = 2.0 * np.pi * fs * t + phases
    sines = np.sin(angles)
    for i in range(1, len(t)):
        for j in (int(sines[:, i].argmin()), int(sines[:, i].argmax()), 0):
            at = 2 * flint.arb.pi() * flint.arb(fs[j, i]) * flint.arb(t[i]) + flint.arb(
                phases[j, i]
            )
            for amplitude in (4.9, 5.0):
                truth = flint.arb(amplitude) * at.sin()
                assert reference.inside(got.inf[i], got.sup[i], truth)
    ends = np.array(
        [4.9 * sines.min(0), 4.9 * sines.max(0), 5.0 * sines.min(0), 5.0 * sines.max(0)]
    )
    width = np.ptp(ends, axis=0)[1:]
    assert np.all((got.sup - got.inf)[1:] <= 1.06 * width + 1e-13)


@pytest.mark.parametrize("coil", [False, True])
def test_a_direct_voltage_encloses_all_members(*, coil: bool) -> None:
    """At f = 0 the source is ``Vm·sin ψ``, so ``h = sin ψ·(1 - e^(-t/τ))``."""
    rng = np.random.default_rng(41)
    for _ in range(60):
        start, width = rng.uniform(-4.0, 4.0), rng.choice([1e-9, 0.1, 1.0, 7.0])
        psi = Interval(start, start + width)
        low = np.exp(rng.uniform(-9.0, 9.0, 2))
        high = low * (1.0 + rng.choice([0.0, 1e-6, 0.25, 3.0], 2))
        r, other = Interval(low[0], high[0]), Interval(low[1], high[1])
        t = float(np.exp(rng.uniform(-3.0, 3.0)) * (low[1] / low[0] if coil else low[1] * low[0]))
        source: dict[str, Any] = {"amplitude": 1.0, "frequency": 0.0, "phase": psi}
        if coil:
            got = magfes_current(t, **source, coil_resistance=r, inductance=other)
        else:
            got = ecfes_voltage(t, **source, capacitor_resistance=r, capacitance=other)
        shares = _box(rng, 2000)
        a, b = low[:, None] + shares[:2] * (high - low)[:, None]
        sine = np.sin(psi.inf + shares[2] * (psi.sup - psi.inf))
        truth = sine * -np.expm1(-t * a / b) / a if coil else sine * -np.expm1(-t / (a * b))
        room = 1e-12 * np.abs(truth).max()
        assert got.inf <= truth.min() + room
        assert got.sup >= truth.max() - room
        assert got.wid <= 1.05 * (truth.max() - truth.min()) + 2.0 * room


def test_a_direct_voltage_reaches_its_greatest_phase() -> None:
    got = ecfes_voltage(
        5e-3, amplitude=1.0, frequency=0.0, phase=Interval(0.4, 1.4),
        capacitor_resistance=Interval(4e3, 5e3), capacitance=1.5e-6,
    )  # fmt: skip
    assert got.sup >= 0.557175


@pytest.mark.parametrize("far", [2.0**63, 1e20, 1e40])
def test_a_source_reaches_its_crests_however_far_the_time(far: float) -> None:
    got = source_voltage(far, amplitude=2.0, frequency=Interval(1.0, 1.5), phase=0.0)
    assert got.inf <= -2.0
    assert got.sup >= 2.0


@pytest.mark.parametrize(
    ("amplitude", "frequency", "phase", "time"),
    [
        (100.0, 1e40, 1.9e-12, 2.5e-4),
        (1.0, 9.6e34, -81.7, 4.7e19),
        (1e40, 0.1, 0.0, 5e-324),
        (1e40, 0.0, 5e-324, 1.0),
    ],
)
def test_a_source_keeps_its_phase_beside_any_number_of_turns(
    amplitude: float, frequency: float, phase: float, time: float
) -> None:
    flint.ctx.prec = 2000
    arb = flint.arb
    angle = 2 * arb.pi() * arb(frequency) * arb(time) + arb(phase)
    got = source_voltage(time, amplitude=amplitude, frequency=frequency, phase=phase)
    assert reference.inside(float(got.inf), float(got.sup), arb(amplitude) * angle.sin())


@pytest.mark.parametrize(
    ("amplitude", "f", "psi", "t", "r", "inductance"),
    [
        (1e-310, 0.0, 0.2560328368344471, 0.00053, 1e-40, 6.728477246859797e-25),
        (2.3e-308, 111.7, 8.84e-15, 1.85, 2.2044426025875987e-09, 1e-40),
        (3e-310, 50.0, 0.3, 1e-3, 1e-40, 1e-38),
    ],
)
def test_an_amplitude_below_all_normal_floats_is_enclosed(
    amplitude: float, f: float, psi: float, t: float, r: float, inductance: float
) -> None:
    flint.ctx.prec = 2000
    source: dict[str, Any] = {"amplitude": amplitude, "frequency": f, "phase": psi}
    got = magfes_current(t, **source, coil_resistance=r, inductance=inductance)
    truth = flint.arb(amplitude) * reference.current(f, psi, t, r, inductance)
    assert reference.inside(float(got.inf), float(got.sup), truth)
