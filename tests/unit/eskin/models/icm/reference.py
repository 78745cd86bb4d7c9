"""The ICM at 200 bits and more, and boxes of parameters to try it on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import flint
import numpy as np

from eskin.interval import Interval

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

BITS = 300


def response(f: Any, tau: Any, psi: Any, t: Any) -> Any:
    """``h`` by the formula of eq. 26 and 27; the bits pay for its cancellation."""
    arb = flint.arb
    omega = 2 * arb.pi() * arb(f)
    x, phase = omega * tau, arb(psi)
    theta = omega * arb(t) + phase
    left = (-arb(t) / tau).exp()
    settled = theta.sin() - x * theta.cos()
    return (settled - (phase.sin() - x * phase.cos()) * left) / (1 + x * x)


def voltage(f: float, psi: float, t: float, r: float, c: float) -> Any:
    """u_c/Vm."""
    return response(f, flint.arb(r) * flint.arb(c), psi, t)


def current(f: float, psi: float, t: float, r: float, inductance: float) -> Any:
    """i1/Vm."""
    return response(f, flint.arb(inductance) / flint.arb(r), psi, t) / flint.arb(r)


def inside(lo: float, hi: float, truth: Any) -> bool:
    """Whether the truth lies in the bounds."""
    return bool(flint.arb(lo) <= truth.mid()) and bool(truth.mid() <= flint.arb(hi))


@dataclass(frozen=True)
class Cases:
    """One sample in time for each of many boxes."""

    f: Floats
    psi: Floats
    t: Floats
    r: Interval
    other: Interval


def cases(seed: int, n: int, *, coil: bool) -> Cases:
    """Boxes of any stiffness, at any time, thin to wide, with the hard phases among them."""
    rng = np.random.default_rng(seed)
    f = 10.0 ** rng.uniform(-3.0, 6.0, n)
    x = 10.0 ** np.where(rng.random(n) < 0.5, rng.uniform(-9.0, 9.0, n), rng.uniform(-1.5, 1.5, n))
    tau = x / (2.0 * np.pi * f)
    t = np.choose(
        rng.integers(0, 4, n),
        [
            10.0 ** rng.uniform(-9.0, 3.0, n) * tau,
            10.0 ** rng.uniform(-12.0, 3.0, n) / f,
            10.0 ** rng.uniform(-1.0, 1.0, n) * tau,
            rng.uniform(0.0, 3.0, n) / f,
        ],
    )
    psi = np.choose(
        rng.integers(0, 5, n),
        [
            np.zeros(n),
            rng.uniform(-4.0, 4.0, n),
            rng.choice([np.pi / 2, np.pi, -np.pi], n),
            np.full(n, np.deg2rad(-46.0)),
            10.0 ** rng.uniform(-20.0, 2.0, n),
        ],
    )
    wide = np.choose(
        rng.integers(0, 4, n),
        [np.full(n, 0.05), np.full(n, 0.2), 10.0 ** rng.uniform(-15.0, -1.0, n),
         rng.uniform(0.0, 0.9, n)],
    )  # fmt: skip
    less = wide * np.choose(rng.integers(0, 3, n), [np.zeros(n), np.ones(n), rng.random(n)])
    r = np.where(rng.random(n) < 0.2, rng.choice([1.0, 1e4], n), 10.0 ** rng.uniform(0.0, 4.0, n))
    other = tau * r if coil else tau / r
    first = rng.random(n) < 0.6
    on_r, on_other = np.where(first, wide, less), np.where(first, less, wide)
    return Cases(
        f, psi, t,
        Interval(r * (1.0 - on_r), r * (1.0 + on_r)),
        Interval(other * (1.0 - on_other), other * (1.0 + on_other)),
    )  # fmt: skip


def along(a: Floats, b: Floats, n: int) -> Floats:
    """``n`` members of each interval, evenly in the logarithm, ends included."""
    share = np.linspace(0.0, 1.0, n)
    members = a[:, None] * (b / a)[:, None] ** share
    return np.clip(members, a[:, None], b[:, None])
