"""Thin parameters: two words hold the truth within a few floats."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import flint
import numpy as np
import pytest

from eskin.interval import Interval
from eskin.kernels.double_double import product_of
from eskin.kernels.jit import part
from eskin.kernels.logarithm import ONE
from eskin.kernels.trig_double_double import reduced, sine_and_cosine
from eskin.models.icm import ecfes_voltage, magfes_current
from eskin.models.icm.thin import (
    ERROR,
    branch_in_two_words,
    respond_in_two_words,
    sample_in_two_words,
)
from tests.unit.eskin.models.icm import reference

if TYPE_CHECKING:
    from collections.abc import Iterable

N = 3000


@pytest.fixture(autouse=True)
def _many_bits() -> Iterable[None]:
    before = flint.ctx.prec
    flint.ctx.prec = reference.BITS
    yield
    flint.ctx.prec = before


@pytest.mark.parametrize("coil", [False, True])
def test_bounds_enclose_and_are_a_few_floats_wide(*, coil: bool) -> None:
    boxes = reference.cases(21, N, coil=coil)
    t = boxes.t.copy()
    t[: N // 10] = 10.0 ** np.random.default_rng(21).uniform(-320.0, -100.0, N // 10)
    r, other = np.asarray(boxes.r.inf), np.asarray(boxes.other.inf)
    source: dict[str, Any] = {"amplitude": -3.3, "frequency": boxes.f, "phase": boxes.psi}
    if coil:
        got = magfes_current(t, **source, coil_resistance=r, inductance=other)
    else:
        got = ecfes_voltage(t, **source, capacitor_resistance=r, capacitance=other)
    truth = reference.current if coil else reference.voltage
    for i in range(N):
        flint.ctx.prec = reference.BITS if t[i] > 1e-40 else 4000
        exact = -flint.arb(3.3) * truth(boxes.f[i], boxes.psi[i], t[i], r[i], other[i])
        assert reference.inside(got.inf[i], got.sup[i], exact), i
    width = (got.sup - got.inf) / np.spacing(np.maximum(np.abs(got.inf), np.abs(got.sup)))
    known = width[t > 1e-150]
    assert np.median(known) <= 1.0
    assert np.mean(known <= 2.0) > 0.99


def test_amplitudes_of_either_sign_and_great_phases_are_enclosed() -> None:
    phase = np.array([0.3, -2.0, 1e6, 1e15, -1e17])
    t = np.array([1e-4, 3e-3, 1e-2, 2e-3, 4e-3])
    got = ecfes_voltage(
        t, amplitude=Interval(-2.0, 5.0), frequency=50.0, phase=phase,
        capacitor_resistance=2419.0, capacitance=1e-6,
    )  # fmt: skip
    for i in range(t.size):
        unit = reference.voltage(50.0, phase[i], t[i], 2419.0, 1e-6)
        for amplitude in (-2, 0, 5):
            assert reference.inside(got.inf[i], got.sup[i], amplitude * unit)
        assert got.sup[i] - got.inf[i] <= 7.0 * abs(float(unit)) + 1e-9


@part
def _respond(f: float, psi: float, t: float, r: float, c: float) -> tuple[float, float, float]:
    over = product_of(r, c)
    sine, cosine = sine_and_cosine(reduced(psi))
    c0, c1 = branch_in_two_words(f, over, ONE)
    terms = sine, cosine, c0, c1, over, ONE
    h, size = respond_in_two_words(terms, sample_in_two_words(f, t))
    return h[0], h[1], size


def test_rounding_stays_within_half_of_its_bound() -> None:
    boxes = reference.cases(22, N, coil=False)
    worst = 0.0
    for i in range(N):
        given = boxes.f[i], boxes.psi[i], boxes.t[i], boxes.r.inf[i], boxes.other.inf[i]
        high, low, size = _respond(*given)
        error = abs(flint.arb(high) + flint.arb(low) - reference.voltage(*given)) / flint.arb(size)
        worst = max(worst, float(error.mid()))
    assert 0.001 * ERROR < worst < 0.5 * ERROR
