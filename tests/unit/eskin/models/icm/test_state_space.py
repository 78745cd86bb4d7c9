from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eskin.errors import IntervalError
from eskin.models.icm import IcmParameters, ecfes_voltage, magfes_current, state_space

CIRCUIT = {
    "coil_resistance": 2.0,
    "inductance": 3e-3,
    "capacitor_resistance": 2419.0,
    "capacitance": 1e-6,
}
SOURCE = {"amplitude": 5.0, "frequency": 50.0, "phase": -0.8}


def test_bounds_hold_what_an_independent_integrator_finds() -> None:
    system = state_space(**CIRCUIT)
    t = np.linspace(0.0, 30e-3, 301)
    omega = 2.0 * np.pi * 50.0
    found = solve_ivp(
        lambda at, x: system.slope(x, 5.0 * np.sin(omega * at - 0.8)),
        (0.0, 30e-3), [0.0, 0.0], method="DOP853", t_eval=t, rtol=1e-12, atol=1e-14,
    )  # fmt: skip
    current = magfes_current(t, **SOURCE, coil_resistance=2.0, inductance=3e-3)
    voltage = ecfes_voltage(t, **SOURCE, capacitor_resistance=2419.0, capacitance=1e-6)
    for bounds, values in zip((current, voltage), found.y, strict=True):
        assert np.all(values >= bounds.inf - 1e-10)
        assert np.all(values <= bounds.sup + 1e-10)


def test_phasor_response_agrees_with_the_closed_form() -> None:
    t = np.linspace(-1e-3, 30e-3, 500)
    current, voltage = state_space(**CIRCUIT).phasor_response(t, **SOURCE)
    i1 = magfes_current(t, **SOURCE, coil_resistance=2.0, inductance=3e-3)
    u_c = ecfes_voltage(t, **SOURCE, capacitor_resistance=2419.0, capacitance=1e-6)
    np.testing.assert_allclose(current, i1.inf, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(voltage, u_c.sup, rtol=1e-12, atol=1e-14)


def test_bounds_hold_the_solution_of_the_equations_at_200_bits() -> None:
    """The integral of the state's own weighting function, not the closed form."""
    with mpmath.workprec(200):
        t, tau = mpmath.mpf(0.0043), mpmath.mpf(2419.0) * mpmath.mpf(1e-6)
        omega = 2 * mpmath.pi * 50
        truth = mpmath.quad(
            lambda z: (
                mpmath.exp(-z / tau) / tau * 5 * mpmath.sin(omega * (t - z) + mpmath.mpf(-0.8))
            ),
            mpmath.linspace(0, t, 9),
        )
        got = ecfes_voltage(0.0043, **SOURCE, capacitor_resistance=2419.0, capacitance=1e-6)
        assert mpmath.mpf(float(got.inf)) <= truth <= mpmath.mpf(float(got.sup))


def test_resolvent_inverts_and_its_determinant_is_the_characteristic() -> None:
    system = state_space(**CIRCUIT)
    s = 3.0 + 400.0j
    inverse = s * np.eye(2) - system.a
    np.testing.assert_allclose(system.resolvent(s) @ inverse, np.eye(2), atol=1e-12)
    assert system.characteristic(s) == pytest.approx(complex(np.linalg.det(inverse)))


def test_eigenvalue_as_frequency_is_refused() -> None:
    system = state_space(**CIRCUIT)
    with pytest.raises(IntervalError, match="eigenvalue"):
        system.resolvent(complex(system.a[0, 0]))


@pytest.mark.parametrize("name", list(CIRCUIT))
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_wrong_component_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(IntervalError, match=name):
        state_space(**{**CIRCUIT, name: value})


def test_defaults_satisfy_the_papers_sentences_on_figure_10() -> None:
    paper = IcmParameters()
    t = np.linspace(0.0, 1e-3, 101)
    voltage, source = paper.ecfes_voltage(t), paper.source_voltage(t)
    current = paper.magfes_current(t)
    assert voltage.mid[-1] == pytest.approx(-1.0, abs=1e-3)
    assert np.all(np.diff(source.mid) > 0.0)
    assert np.all(np.diff(voltage.mid) < 0.0)
    assert current.mid[1] == pytest.approx(-0.36e-3, abs=2e-6)
    assert current.mid[-1] == pytest.approx(-0.24e-3, abs=6e-6)
    assert np.all(np.diff(current.mid[1:]) > 0.0)
