"""The paper's ³S models: pure functions of time and parameters, each with interval bounds.

A parameter is an `eskin.Interval` or a number or array for a thin one, in SI units; parameters and
times broadcast as in numpy, taxels × times say. A plain name is the right physics; a name that ends
in ``_paper`` is the paper's own form where that is wrong. The hybrid sensor of eq. 15 to 29 stands
in `eskin.models.icm`; the same models as plain expressions, for `eskin.design`, in
`eskin.models.formulas`.
"""

from __future__ import annotations

from eskin.models import formulas, icm
from eskin.models.alternating import (
    Swing,
    alternating_capacitance,
    alternating_capacitance_paper,
    alternating_current,
    alternating_current_paper,
)
from eskin.models.capacitive_chain import (
    CapacitiveChain,
    capacitive_chain,
    chain_current,
    harmonic_capacitance,
)
from eskin.models.capacitor import capacitance
from eskin.models.coil import CoilCurrent, coil_current
from eskin.models.coil_energy import coil_energy
from eskin.models.energy_flow import EnergyFlow, energy_flow
from eskin.models.euler import EulerEnergy, EulerRule, coil_energy_euler_paper
from eskin.models.moving_plate import MovingPlate, moving_plate
from eskin.models.oscillation import oscillation, oscillation_paper
from eskin.models.oscillator import lc_frequency, rc_frequency, rc_frequency_paper
from eskin.models.proximity import Proximity, proximity, proximity_at
from eskin.models.resonance import Resonance, resonance
from eskin.models.touch import Touch, touch, touch_of_area

__all__ = [
    "CapacitiveChain",
    "CoilCurrent",
    "EnergyFlow",
    "EulerEnergy",
    "EulerRule",
    "MovingPlate",
    "Proximity",
    "Resonance",
    "Swing",
    "Touch",
    "alternating_capacitance",
    "alternating_capacitance_paper",
    "alternating_current",
    "alternating_current_paper",
    "capacitance",
    "capacitive_chain",
    "chain_current",
    "coil_current",
    "coil_energy",
    "coil_energy_euler_paper",
    "energy_flow",
    "formulas",
    "harmonic_capacitance",
    "icm",
    "lc_frequency",
    "moving_plate",
    "oscillation",
    "oscillation_paper",
    "proximity",
    "proximity_at",
    "rc_frequency",
    "rc_frequency_paper",
    "resonance",
    "touch",
    "touch_of_area",
]
