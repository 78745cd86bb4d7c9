"""The ICM's parameters, with the paper's values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from eskin.models.icm.responses import ecfes_voltage, magfes_current, source_voltage

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from eskin.interval import Interval
    from eskin.models.parameters import Bounds


_PHASE: Final = math.radians(-46.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class IcmParameters:
    """Both branches of an inductive-capacitive sensor at one source; the defaults are Fig. 10's.

    The paper gives Vm, f, C and L. It gives neither R1, R2 nor ψ, and its sentences about Fig. 10
    cannot all hold. R1 = 10 kΩ, R2 = 2419 Ω and ψ = -46° satisfy most of them: a MagFES current
    of -0.36 to -0.24 mA that follows the source, and an EcFES voltage that falls by 1.0 V in the
    first millisecond while the source rises, mainly by the exponential.

    Attributes:
        amplitude: Vm in V.
        frequency: f in Hz.
        phase: ψ in rad.
        coil_resistance: R1 in Ω.
        inductance: L in H.
        capacitor_resistance: R2 in Ω.
        capacitance: C in F.
    """

    amplitude: Bounds = 5.0
    frequency: Bounds = 50.0
    phase: Bounds = _PHASE
    coil_resistance: Bounds = 10e3
    inductance: Bounds = 1e-3
    capacitor_resistance: Bounds = 2419.0
    capacitance: Bounds = 1e-6

    def source_voltage(self, time: ArrayLike) -> Interval:
        """V(t) in V, see `eskin.models.icm.source_voltage`."""
        return source_voltage(
            time, amplitude=self.amplitude, frequency=self.frequency, phase=self.phase
        )

    def magfes_current(self, time: ArrayLike) -> Interval:
        """i1(t) in A, see `eskin.models.icm.magfes_current`."""
        return magfes_current(
            time,
            amplitude=self.amplitude,
            frequency=self.frequency,
            phase=self.phase,
            coil_resistance=self.coil_resistance,
            inductance=self.inductance,
        )

    def ecfes_voltage(self, time: ArrayLike) -> Interval:
        """u_c(t) in V, see `eskin.models.icm.ecfes_voltage`."""
        return ecfes_voltage(
            time,
            amplitude=self.amplitude,
            frequency=self.frequency,
            phase=self.phase,
            capacitor_resistance=self.capacitor_resistance,
            capacitance=self.capacitance,
        )
