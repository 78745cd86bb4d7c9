"""The ICM's equations of state (eq. 15 to 25) as matrices.

``x' = A x + B u`` with ``x = (i1, u_c)`` and ``u = V(t)``; the two branches do not act on each
other, so A is diagonal. The closed form (eq. 26, 27) stands in `eskin.models.icm`.

Eq. 23 transforms ``Vm·e^(jωt)``, not the source ``Vm·sin(ωt + ψ)`` that it names: for the source,
keep the factor ``e^(jψ)`` and take the imaginary part of eq. 25. `phasor_response` does, so it is
the corrected form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eskin.errors import IntervalError
from eskin.interval import require_plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StateSpace:
    """Matrices of eq. 17 and 18.

    Attributes:
        a: A in 1/s, 2 × 2: ``diag(-R1/L, -1/(R2 C))``.
        b: B, 2 × 1: 1/L in A/(V s), 1/(R2 C) in 1/s.
    """

    a: Floats
    b: Floats

    def slope(self, state: ArrayLike, voltage: float) -> Floats:
        """``x' = A x + B u`` (eq. 17) for a state (i1 in A, u_c in V) and a source in V."""
        require_plain(state, "state")
        require_plain(voltage, "voltage")
        return self.a @ np.asarray(state, dtype=np.float64) + self.b[:, 0] * voltage

    def resolvent(self, s: complex) -> NDArray[np.complex128]:
        """``(s·1 - A)⁻¹`` (eq. 22) at a complex frequency in 1/s.

        Raises:
            IntervalError: ``s`` is an eigenvalue of A.
        """
        poles = s - np.diag(self.a)
        if np.any(poles == 0.0):
            raise IntervalError(f"s must not be an eigenvalue of A, is {s!r}")
        return np.diag(1.0 / poles)

    def characteristic(self, s: complex) -> complex:
        """``det(s·1 - A)`` (eq. 21)."""
        return complex(np.prod(s - np.diag(self.a)))

    def phasor_response(
        self, time: ArrayLike, *, amplitude: float, frequency: float, phase: float
    ) -> Floats:
        """Response from rest to ``Vm·sin(ωt + ψ)·1(t)`` through eq. 24 and 25, corrected.

        Plain floating point, no enclosure: eq. 24 is split into partial fractions, its inverse
        transform multiplied by ``e^(jψ)``, and the imaginary part taken.

        Args:
            time: t in s, any shape; the state is zero before 0.
            amplitude: Vm in V.
            frequency: f in Hz.
            phase: ψ in rad.

        Raises:
            IntervalError: A value carries a unit.

        Returns:
            i1 in A and u_c in V along a first axis of 2.
        """
        given = {"time": time, "amplitude": amplitude, "frequency": frequency, "phase": phase}
        for name, value in given.items():
            require_plain(value, name)
        t = np.maximum(np.asarray(time, dtype=np.float64), 0.0)
        omega = 2.0 * np.pi * frequency
        poles = np.diag(self.a)
        shape = (2,) + (1,) * t.ndim
        residues = (self.resolvent(1j * omega) @ self.b)[:, 0].reshape(shape)
        modes = np.exp(1j * omega * t) - np.exp(poles.reshape(shape) * t)
        return np.imag(amplitude * np.exp(1j * phase) * residues * modes)


def state_space(
    *,
    coil_resistance: float,
    inductance: float,
    capacitor_resistance: float,
    capacitance: float,
) -> StateSpace:
    """Equations of state of both branches (eq. 18).

    Args:
        coil_resistance: R1 in Ω, > 0.
        inductance: L in H, > 0.
        capacitor_resistance: R2 in Ω, > 0.
        capacitance: C in F, > 0.

    Raises:
        IntervalError: A parameter is not a finite number greater than zero.
    """
    given = {
        "coil_resistance": coil_resistance,
        "inductance": inductance,
        "capacitor_resistance": capacitor_resistance,
        "capacitance": capacitance,
    }
    for name, value in given.items():
        require_plain(value, name)
        if not 0.0 < value < np.inf:
            raise IntervalError(f"{name} must be a finite number > 0, is {value!r}")
    charging = 1.0 / (capacitor_resistance * capacitance)
    a = np.diag([-coil_resistance / inductance, -charging])
    return StateSpace(a, np.array([[1.0 / inductance], [charging]]))
