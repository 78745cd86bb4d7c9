"""Where corners are unsound, ours is not: extremes inside the intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eskin.interval import Interval
from eskin.models.icm import ecfes_voltage, magfes_current

if TYPE_CHECKING:
    from tests.unit.eskin.models.icm.reference import Floats


def _h(f: float, tau: Floats, psi: float, t: Floats) -> Floats:
    omega = 2.0 * np.pi * f
    x, theta = omega * tau, omega * t + psi
    settled = np.sin(theta) - x * np.cos(theta)
    settled = settled - (np.sin(psi) - x * np.cos(psi)) * np.exp(-t / tau)
    return np.asarray(settled / (1.0 + x * x))


def test_corners_miss_a_part_of_the_voltage_and_ours_does_not() -> None:
    t = np.linspace(1e-4, 20e-3, 400)
    r, c = Interval(0.8 * 2419.0, 1.2 * 2419.0), Interval(0.8e-6, 1.2e-6)
    psi = np.deg2rad(-46.0)
    got = ecfes_voltage(
        t, amplitude=1.0, frequency=50.0, phase=psi, capacitor_resistance=r, capacitance=c
    )
    corners = np.array([_h(50.0, a * b, psi, t) for a in (r.inf, r.sup) for b in (c.inf, c.sup)])
    taus = np.geomspace(r.inf * c.inf, r.sup * c.sup, 2001)[:, None]
    all_of_it = _h(50.0, taus, psi, t)
    true_width = np.ptp(all_of_it, axis=0)
    assert np.min(np.ptp(corners, axis=0) / true_width) < 0.88
    slack = 1e-12  # what the plain formula itself may be off by
    assert np.all(got.inf <= all_of_it.min(axis=0) + slack)
    assert np.all(got.sup >= all_of_it.max(axis=0) - slack)
    assert np.all(got.sup - got.inf <= 1.001 * true_width)


def test_corners_miss_a_part_of_the_current_and_ours_does_not() -> None:
    t = np.linspace(1e-4, 20e-3, 400)
    r, inductance = Interval(0.8, 1.2), Interval(0.8 * 3e-3, 1.2 * 3e-3)
    got = magfes_current(
        t, amplitude=1.0, frequency=50.0, phase=0.0, coil_resistance=r, inductance=inductance
    )
    members_r = np.geomspace(0.8, 1.2, 401)[:, None, None]
    members_l = np.geomspace(0.8 * 3e-3, 1.2 * 3e-3, 41)[:, None]
    all_of_it = (_h(50.0, members_l / members_r, 0.0, t) / members_r).reshape(-1, t.size)
    corners = all_of_it.reshape(401, 41, -1)[::400, ::40].reshape(4, -1)
    true_width = np.ptp(all_of_it, axis=0)
    assert np.min(np.ptp(corners, axis=0) / true_width) < 0.95
    slack = 1e-12  # what the plain formula itself may be off by
    assert np.all(got.inf <= all_of_it.min(axis=0) + slack)
    assert np.all(got.sup >= all_of_it.max(axis=0) - slack)
    assert np.median((got.sup - got.inf) / true_width) <= 1.0001
    assert np.all(got.sup - got.inf <= 1.004 * true_width)  # the grid's own gap


def test_wider_parameters_give_wider_bounds() -> None:
    rng = np.random.default_rng(4)
    n = 3000
    t = rng.uniform(0.0, 20e-3, n)
    psi = rng.uniform(-3.0, 3.0, n)
    inner, outer = np.sort(rng.uniform(0.0, 0.4, (2, n)), axis=0)
    shift = rng.uniform(-1.0, 1.0, n) * (outer - inner) * 0.99

    def bounds(low: Floats, high: Floats) -> list[Interval]:
        source: dict[str, Any] = {"amplitude": 5.0, "frequency": 50.0, "phase": psi}
        share = Interval(low, high)
        return [
            ecfes_voltage(
                t, **source, capacitor_resistance=2419.0, capacitance=_times(share, 1e-6)
            ),
            magfes_current(
                t, **source, coil_resistance=_times(share, 1.0), inductance=_times(share, 3e-3)
            ),
        ]

    inside = bounds(1.0 + shift - inner, 1.0 + shift + inner)
    outside = bounds(1.0 - outer, 1.0 + outer)
    for narrow, broad in zip(inside, outside, strict=True):
        slack = 1e-5 * (broad.sup - broad.inf)  # an extremum is bracketed, not met
        assert np.all(broad.inf - slack <= narrow.inf)
        assert np.all(broad.sup + slack >= narrow.sup)


def test_hull_of_the_parts_is_the_whole() -> None:
    t = np.linspace(0.0, 20e-3, 300)
    cuts = np.geomspace(0.8e-6, 1.2e-6, 9)
    source: dict[str, Any] = {
        "amplitude": 5.0,
        "frequency": 50.0,
        "phase": -0.8,
        "capacitor_resistance": 2419.0,
    }
    whole = ecfes_voltage(t, **source, capacitance=Interval(cuts[0], cuts[-1]))
    parts = ecfes_voltage(t, **source, capacitance=Interval(cuts[:-1, None], cuts[1:, None]))
    width = whole.sup - whole.inf
    assert np.all(np.abs(parts.inf.min(axis=0) - whole.inf) <= 1e-5 * width)
    assert np.all(np.abs(parts.sup.max(axis=0) - whole.sup) <= 1e-5 * width)


def _times(share: Interval, value: float) -> Interval:
    return Interval(share.inf * value, share.sup * value)
